"""Which effects a motion shows, and from which size on.

Only columns and noise enter: the model's own parameters absorb a part of each column, and what is
left must stand out of the noise.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.refit.baseline import Baseline, rows_of
from idim_iv_ros.diagnosis.refit.noise_floor import NoiseFloor
from idim_iv_ros.diagnosis.result.document import NotTestable
from idim_iv_ros.effects.effect import Effect, JointRange, Place, Shape
from idim_iv_ros.estimation.likelihood import Columns, Fit, Regression, width_of
from idim_iv_ros.signals.autoregression import AutoregressiveModel
from idim_iv_ros.types import FloatArray

_SPREAD_SHAPES = 4  # of a grid, by which an effect is judged from the motion alone
_LARGEST_TORQUE = 1e6  # N m, from which on a shape's transmission has run away
_TORQUE = "an effort that is the torque of this joint, in enough rows"

_MOST_SCALED = 1.5  # times that a shaft or a delay is scaled up to be seen
_NONCENTRALITY = 20.0  # chi-square at which an effect is seen
_LEAST_SHARE = 0.01  # of the whitened residual, the same
_TINY = 1e-12

Made = Callable[[Effect, Place, Shape], Columns | None]


class Absorption:
    """What the parameters of a model leave of columns, whitened by the noise of the joints.

    Whitened columns w are projected on the orthonormal columns M R⁻¹ of the model: what is left has
    the energy wᵀw − pᵀp with p = R⁻ᵀMᵀw.
    """

    def __init__(self, regression: Regression, noise_models: Sequence[AutoregressiveModel]) -> None:
        self.joints, self._noise_models = regression.extended, noise_models
        pairs = zip(self.joints, noise_models, strict=True)
        self._model = [noise.standardized(rows.matrix, rows.segments) for rows, noise in pairs]
        basis, _ = regression.whitened_basis(noise_models)
        self._root = basis.inverse_root(regression.total)  # R⁻¹

    def left(self, columns: Columns) -> tuple[FloatArray, FloatArray]:
        """Energy of the columns, and of what is left of them, (k,) each."""
        inner = np.zeros((len(self._root), width_of(columns)))
        energy = np.zeros(inner.shape[1])
        for joint, rows in columns.items():
            of_model = self.joints[joint]
            white = self._noise_models[joint].standardized(rows, of_model.segments)
            inner[of_model.columns] += self._model[joint].T @ white
            energy += np.sum(white**2, axis=0)
        return energy, np.maximum(energy - np.sum((self._root.T @ inner) ** 2, axis=0), 0.0)


def detectability(
    data: Baseline, absorption: Absorption, effect: Effect, place: Place, made: Made
) -> tuple[str, str]:
    """Why the motion does not show an effect, and from which size on it would; empty if it does.

    An effect that shows only from an implausible size on (`Effect.plausible`) is not shown. A few
    shapes are tried, from all over the grid, that are possible on the motion.
    """
    joint, covered = place.joint, data.covered[place.joint]
    grid = effect.grid(covered)
    spread = np.linspace(0, max(len(grid) - 1, 0), _SPREAD_SHAPES).round().astype(int)
    tried = {grid[k]: made(effect, place, grid[k]) for k in np.unique(spread)} if grid else {}
    missing = [shape for shape, table in tried.items() if table is None]
    tried.update(zip(missing, rows_of(data, effect, place, missing), strict=True))
    shapes = [
        (shape, table)
        for shape, table in tried.items()
        if table is not None
        and all(np.max(np.abs(rows), initial=0.0) < _LARGEST_TORQUE for rows in table.values())
    ]
    if not shapes:
        return "no shape of it is possible on this motion", ""
    needed, least_absorbed = max(_NONCENTRALITY, _LEAST_SHARE * len(absorption.joints[joint])), 1.0
    options: list[tuple[bool, float, str]] = []
    for shape, columns in shapes:
        energy, rest = absorption.left(columns)
        share = rest / np.maximum(energy, _TINY)
        least_absorbed = min(least_absorbed, 1.0 - float(share.max()))
        largest = np.abs(columns.get(joint, np.zeros((1, len(rest))))).max(axis=0)
        # Coefficients at which each column alone is just seen; one where the shape is the size.
        sizes = np.sqrt(needed / np.maximum(rest, _TINY))
        sizes[share <= 1.0 - settings.ABSORBED] = np.inf
        if effect.size_in == "shape":
            sizes = np.where(sizes <= 1.0, 1.0, np.inf)
        else:
            most = _MOST_SCALED if effect.size_in == "scale" else np.inf
            sizes[(largest <= 0.0) | (sizes > most)] = np.inf
        column = int(np.argmin(sizes * np.maximum(largest, _TINY)))
        if not np.isfinite(sizes[column]):
            continue
        coefficients = np.where(np.arange(len(sizes)) == column, sizes, 0.0)
        size = torque = float(sizes[column] * largest[column])
        if effect.size_in == "shape":
            size, torque = shape.numbers[0], 0.0
        plausible = effect.plausible(shape, coefficients, torque, covered)
        options.append((not plausible, size, effect.size_in_words(shape, coefficients, torque)))
    if least_absorbed > settings.ABSORBED:
        absorbed = f"{100.0 * least_absorbed:.1f} %"
        return f"the model's own parameters absorb {absorbed} of it on this motion", ""
    if not options:
        return "its torque stays within the noise at every size that was tried", ""
    implausible, _, words = min(options)
    if not implausible:
        return "", ""
    return f"it would be seen from {words} on, and is often smaller", words


def cannot_show(effect: Effect, covered: JointRange) -> str:
    """Why an effect cannot be seen at a joint whatever its size; empty where it may be.

    Each effect adds what it needs itself.
    """
    if covered.left_out:
        return "its torque is left out: the summary says why"
    slow = covered.fastest <= settings.LEAST_SPEED_RANGE * covered.slowest
    if slow or covered.span <= settings.LEAST_RANGE * covered.lever:
        return f"the joint hardly moves ({covered.span:.2g} {covered.length})"
    if covered.fastest < settings.LEAST_FASTEST * covered.lever:
        return (
            f"the joint moves at most {covered.fastest:.2g} {covered.length}/s: it sticks so often "
            "that its dry friction hides everything else"
        )
    return effect.cannot_show(covered)


def too_little(covered: JointRange) -> bool:
    """Whether a joint moves so little that not even its parameters can be determined.

    Slow motion over a wide range shows weights and friction well; small motion that sticks shows
    nothing, and no more does a torque that is left out.
    """
    slow = covered.fastest < settings.LEAST_FASTEST * covered.lever
    least = settings.SMALL_RANGE if slow else settings.LEAST_RANGE
    return covered.left_out or covered.span <= least * covered.lever


def not_shown_by_motion(
    data: Baseline,
    catalogue: Sequence[Effect],
    noise_models: Sequence[AutoregressiveModel],
    made: Made = lambda effect, place, shape: None,
) -> tuple[NotTestable, ...]:
    """Say which effects the motion cannot show, joint by joint.

    Only the regressor of the refit is used, not its torque. `noise_models`: of each joint, given
    beforehand or bounded from below (`floor_noise_models`); `made`: columns that the search has.
    """
    absorption = Absorption(data.regression, noise_models)
    refused = []
    for joint, covered in enumerate(data.covered):
        for effect in catalogue:
            # Of pairs of joints the one with the next joint.
            places = [place for place in effect.places(len(data.joints)) if place.joint == joint]
            for place in places[:1]:
                reason, smallest = cannot_show(effect, covered), ""
                if not reason:
                    reason, smallest = detectability(data, absorption, effect, place, made)
                if reason:
                    needed = _TORQUE if covered.left_out else effect.excitation
                    words = (data.unit_at(joint, text) for text in (reason, needed, smallest))
                    refused.append(NotTestable(effect.name, data.joints[joint], *words))
    return tuple(refused)


def floor_noise_models(fit: Fit, floors: Sequence[NoiseFloor]) -> tuple[AutoregressiveModel, ...]:
    """Noise models of a fit with the standard deviations of the noise floor where it is smaller."""
    return tuple(
        noise
        if floor.sigma is None or floor.sigma >= noise.sigma
        else replace(noise, innovation_variance=floor.sigma**2)
        for noise, floor in zip(fit.noise_models, floors, strict=True)
    )
