"""Which effects a motion shows, and from which size on.

Only columns and noise enter: the model's own parameters absorb a part of each column, and what is
left must stand out of the noise.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.likelihood import Columns, Fit, Regression, width_of
from idim_iv_ros.diagnosis.refit.baseline import Baseline, operating_range, rows_of, spread_shapes
from idim_iv_ros.diagnosis.result import NotTestable
from idim_iv_ros.effects.effect import Effect, JointScale, OperatingRange, Place, Shape
from idim_iv_ros.estimation.qr import NOT_SHOWN, independent_basis, stacked_r_factor
from idim_iv_ros.signals import AutoregressiveModel
from idim_iv_ros.types import FloatArray

_LARGEST_TORQUE = 1e6  # N m, from which on a shape's transmission has run away
_ASSUMED_DRY_FRICTION = 0.05  # largest torques of a joint that shows none: sizes are judged by it
_TORQUE = "an effort that is the torque of this joint, in enough rows"

_MOST_SCALED = 1.5  # times that a shaft or a delay is scaled up to be seen
_NONCENTRALITY = 20.0  # chi-square at which an effect is seen
_LEAST_SHARE = 0.01  # of the whitened residual, the same
_TINY = 1e-12


@dataclass(frozen=True)
class Detectability:
    """What the motion shows of one effect.

    Attributes
    ----------
    absorbed : float
        Share of its energy that the model's own parameters absorb, 0 to 1, of the shape that is
        absorbed least.
    smallest : str
        Smallest size that would be seen, in words; empty where none would.
    plausible : bool
        Whether that is no larger than what is plausible (`Effect.plausible`).
    """

    absorbed: float
    smallest: str
    plausible: bool


class Absorption:
    """What the parameters of a model leave of columns, whitened by the noise of the joints.

    Whitened columns W are projected on the orthonormal columns M R⁻¹ of the model: what is left has
    the products WᵀW − PᵀP with P = R⁻ᵀMᵀW.
    """

    def __init__(self, regression: Regression, noise_models: Sequence[AutoregressiveModel]) -> None:
        self._joints, self._noise_models = regression.extended, noise_models
        pairs = list(zip(self._joints, noise_models, strict=True))
        self._model = [noise.standardized(rows.matrix, rows.segments) for rows, noise in pairs]
        factors = [rows.standardized_r_factor(noise)[:, :-1] for rows, noise in pairs]
        self._total = regression.total
        factor = stacked_r_factor(factors, [rows.columns for rows in self._joints], self._total)
        self._basis = independent_basis(factor, tolerance=NOT_SHOWN)

    def left(self, columns: Columns) -> tuple[FloatArray, FloatArray]:
        """Energy (k,) of the columns, and the products (k, k) of what is left of them."""
        width = width_of(columns)
        inner, products = np.zeros((self._total, width)), np.zeros((width, width))
        for joint, rows in columns.items():
            own = self._joints[joint]
            white = self._noise_models[joint].standardized(rows, own.segments)
            inner[own.columns] += self._model[joint].T @ white
            products += white.T @ white
        projected = scipy.linalg.solve_triangular(
            self._basis.upper, inner[self._basis.kept], trans="T"
        )
        return np.diag(products).copy(), products - projected.T @ projected


def detectability(
    absorption: Absorption,
    effect: Effect,
    shapes: Sequence[tuple[Shape, Columns]],
    rows: int,
    scale: JointScale,
) -> Detectability:
    """Say what the motion shows of an effect in some shapes, each with its columns.

    Parameters
    ----------
    absorption
        By the refit.
    rows
        Of the joint.
    """
    needed = max(_NONCENTRALITY, _LEAST_SHARE * rows)
    absorbed = []
    options: list[tuple[bool, float, str]] = []
    for shape, columns in shapes:
        energy, left = absorption.left(columns)
        energy, rest = np.maximum(energy, _TINY), np.clip(np.diag(left), 0.0, None)
        share = rest / energy
        absorbed.append(1.0 - float(share.max()))
        if effect.size_in == "shape":
            if rest[0] >= needed and share[0] > 1.0 - settings.ABSORBED:
                words, plausible = _judged(effect, shape, np.ones(1), 0.0, scale)
                options.append((plausible, effect.size_of(shape), words))
            continue
        at_joint = columns.get(scale.joint)
        largest = np.zeros(len(rest)) if at_joint is None else np.abs(at_joint).max(axis=0)
        size = np.sqrt(needed / np.maximum(rest, _TINY))
        size[(share < 1.0 - settings.ABSORBED) | (largest <= 0.0)] = np.inf
        if effect.size_in == "scale":
            size[size > _MOST_SCALED] = np.inf
        k = int(np.argmin(size * np.maximum(largest, _TINY)))
        if not np.isfinite(size[k]):
            continue
        coefficients = np.zeros(len(size))
        coefficients[k] = size[k]
        torque = float(size[k] * largest[k])
        words, plausible = _judged(effect, shape, coefficients, torque, scale)
        options.append((plausible, torque, words))
    if not options:
        return Detectability(min(absorbed), "", plausible=False)
    plausible, _, words = min(options, key=lambda option: (not option[0], option[1]))
    return Detectability(min(absorbed), words, plausible)


def _judged(
    effect: Effect, shape: Shape, coefficients: FloatArray, torque: float, scale: JointScale
) -> tuple[str, bool]:
    """Size in words, and whether it is no larger than what is plausible."""
    words = effect.size_in_words(shape, coefficients, torque)
    return words, effect.plausible(shape, coefficients, torque, scale)


def cannot_show(effect: Effect, joint: int, covered: OperatingRange) -> str:
    """Why an effect cannot be seen at a joint whatever its size; empty where it may be.

    Each effect adds what it needs itself.
    """
    if joint in covered.left_out:
        return "its torque is left out: the summary says why"
    lever = float(covered.lever[joint])
    span, length = covered.span(joint), covered.length(joint)
    fastest = float(covered.fastest[joint])
    if (
        span <= settings.LEAST_RANGE * lever
        or fastest <= settings.LEAST_SPEED_RANGE * covered.slowest[joint]
    ):
        return f"the joint hardly moves ({span:.2g} {length})"
    if fastest < settings.LEAST_FASTEST * lever:
        return (
            f"the joint moves at most {fastest:.2g} {length}/s: it sticks so often that its dry "
            "friction hides everything else"
        )
    return effect.cannot_show(joint, covered)


def too_little(joint: int, covered: OperatingRange) -> bool:
    """Whether a joint moves so little that not even its parameters can be determined.

    Slow motion over a wide range shows weights and friction well; small motion that sticks shows
    nothing, and no more does a torque that is left out.
    """
    if joint in covered.left_out:
        return True
    lever = float(covered.lever[joint])
    span = covered.span(joint)
    fastest = float(covered.fastest[joint])
    if span <= settings.LEAST_RANGE * lever:
        return True
    return fastest < settings.LEAST_FASTEST * lever and span < settings.SMALL_RANGE * lever


def not_shown_by_motion(
    data: Baseline,
    regression: Regression,
    catalogue: Sequence[Effect],
    noise_models: Sequence[AutoregressiveModel],
) -> tuple[NotTestable, ...]:
    """Say which effects the motion cannot show, joint by joint.

    Parameters
    ----------
    regression
        Of the refit; only its regressor is used, not its torque.
    noise_models
        Noise of each joint, given beforehand or bounded from below (`floor_noise_models`).
    """
    covered = operating_range(data)
    absorption = Absorption(regression, noise_models)
    friction = _dry_friction(data, covered)
    refused = []
    for joint, rows in enumerate(regression.joints):
        scale = JointScale(covered, joint, friction[joint])
        for effect in catalogue:
            for place in _places(effect, joint, len(data.joints)):
                reason, smallest = cannot_show(effect, joint, covered), ""
                shapes = [] if reason else _shaped(data, effect, place, covered)
                if shapes:
                    measure = detectability(absorption, effect, shapes, len(rows.torque), scale)
                    reason, smallest = _refusal(measure)
                elif not reason:
                    reason = "no shape of it is possible on this motion"
                if reason:
                    needed = _TORQUE if joint in covered.left_out else effect.excitation
                    words = (data.unit_at(joint, text) for text in (reason, needed, smallest))
                    refused.append(NotTestable(effect.name, data.joints[joint], *words))
    return tuple(refused)


def floor_noise_models(fit: Fit, sigmas: Sequence[float | None]) -> tuple[AutoregressiveModel, ...]:
    """Noise models of a fit with the standard deviations of the noise floor where it is smaller."""
    return tuple(
        noise
        if sigma is None or sigma >= noise.sigma
        else replace(noise, innovation_variance=sigma**2)
        for noise, sigma in zip(fit.noise_models, sigmas, strict=True)
    )


def _places(effect: Effect, joint: int, joints: int) -> list[Place]:
    """Places at a joint; of pairs the one with the next joint."""
    places = [place for place in effect.places(joints) if place.joint == joint]
    return places[:1]


def _shaped(
    data: Baseline, effect: Effect, place: Place, covered: OperatingRange
) -> list[tuple[Shape, Columns]]:
    """Shapes from all over the grid that are possible on the motion, with their columns."""
    shapes = spread_shapes(effect, place, covered)
    return [
        (shape, columns)
        for shape, columns in zip(shapes, rows_of(data, effect, place, shapes), strict=True)
        if all(np.max(np.abs(rows), initial=0.0) < _LARGEST_TORQUE for rows in columns.values())
    ]


def _refusal(measure: Detectability) -> tuple[str, str]:
    """Why an effect is not testable, and the smallest size that is; both empty where it is."""
    if measure.absorbed > settings.ABSORBED:
        share = 100.0 * measure.absorbed
        return f"the model's own parameters absorb {share:.1f} % of it on this motion", ""
    if not measure.smallest:
        return "its torque stays within the noise at every size that was tried", ""
    if not measure.plausible:
        reason = f"it would be seen from {measure.smallest} on, and is often smaller"
        return reason, measure.smallest
    return "", ""


def _dry_friction(data: Baseline, covered: OperatingRange) -> list[float]:
    """Dry friction of each joint, N m (N): of the refit, or a share of the peak if it has none."""
    levels = data.prepared.model.dynamic_parameters(data.estimate.linear.values).coulomb
    return [
        float(level)
        if level > settings.LEAST_DRY_FRICTION * peak
        else _ASSUMED_DRY_FRICTION * float(peak)
        for level, peak in zip(levels, covered.torque, strict=True)
    ]
