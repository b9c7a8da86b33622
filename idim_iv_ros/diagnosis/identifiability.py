"""Which effects a motion shows, from which size on, and how they correlate on it.

Only columns and noise enter: the model's own parameters absorb a part of each column, and what is
left must stand out of the noise.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import Confusability, NotTestable
from idim_iv_ros.diagnosis.structural.candidate import operating_range, rows_of, spread_shapes
from idim_iv_ros.diagnosis.structural.likelihood import Columns, Fit, Regression, width_of
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
class ShapedEffect:
    """One effect at one place, with the columns of a few shapes side by side."""

    effect: Effect
    place: Place
    shapes: list[Shape]
    columns: list[Columns]


@dataclass(frozen=True)
class Detectability:
    """What the motion shows of one effect.

    Attributes
    ----------
    absorbed, least_absorbed : float
        Share of its energy that the model's own parameters absorb, 0 to 1: of the middle one of
        its shapes, and of the one that is absorbed least.
    smallest : str
        Smallest size that would be seen, in words; empty where none would.
    plausible : bool
        Whether that is no larger than what is plausible (`Effect.plausible`).
    """

    absorbed: float
    least_absorbed: float
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


@dataclass(frozen=True)
class _Remainder:
    """Columns of all effects at one joint, side by side, less what the model absorbs.

    Attributes
    ----------
    energy : (k,)
        Of the whitened columns.
    left : (k, k)
        Products of what the model does not absorb of them.
    largest : (k,)
        Absolute values of the joint's own columns, not whitened.
    parts : for each effect, the columns of each of its shapes.
    """

    energy: FloatArray
    left: FloatArray
    largest: FloatArray
    parts: list[list[slice]]


def detectability(
    absorption: Absorption, effects: Sequence[ShapedEffect], rows: int, scale: JointScale
) -> tuple[list[Detectability], FloatArray]:
    """Say what the motion shows of all effects at one joint.

    Parameters
    ----------
    absorption
        By the refit.
    rows
        Of the joint.

    Returns
    -------
    tuple
        One for each effect, and their correlations (n, n): largest canonical correlation of what
        the model does not absorb, over all shapes.
    """
    remainder = _remainder(absorption, effects, scale.joint)
    needed = max(_NONCENTRALITY, _LEAST_SHARE * rows)
    measures = [
        _measure(effect, parts, remainder, needed, scale)
        for effect, parts in zip(effects, remainder.parts, strict=True)
    ]
    return measures, _correlations(remainder)


def _remainder(absorption: Absorption, effects: Sequence[ShapedEffect], joint: int) -> _Remainder:
    blocks = [columns for effect in effects for columns in effect.columns]
    widths = [next(iter(columns.values())).shape[1] for columns in blocks]
    touched = sorted({j for columns in blocks for j in columns})
    lengths = {j: len(columns[j]) for columns in blocks for j in columns}
    stacked = {
        j: np.hstack(
            [
                columns[j] if j in columns else np.zeros((lengths[j], width))
                for columns, width in zip(blocks, widths, strict=True)
            ]
        )
        for j in touched
    }
    energy, left = absorption.left(stacked)
    energy = np.maximum(energy, _TINY)
    own = stacked.get(joint)
    largest = np.zeros(len(energy)) if own is None else np.abs(own).max(axis=0)
    ends = np.cumsum(widths)
    slices = iter([slice(int(e) - w, int(e)) for e, w in zip(ends, widths, strict=True)])
    parts = [[next(slices) for _ in effect.shapes] for effect in effects]
    return _Remainder(energy, left, largest, parts)


def _correlations(remainder: _Remainder) -> FloatArray:
    left, energy = remainder.left, remainder.energy
    bases = [
        [(part, _basis(left[part, part], energy[part])) for part in parts]
        for parts in remainder.parts
    ]
    correlation = np.eye(len(bases))
    for a in range(len(bases)):
        for b in range(a):
            values = [
                np.linalg.norm(one.T @ left[first, second] @ two, 2)
                for first, one in bases[a]
                for second, two in bases[b]
                if one.size and two.size
            ]
            correlation[a, b] = correlation[b, a] = min(max(values, default=0.0), 1.0)
    return correlation


def _basis(left: FloatArray, energy: FloatArray) -> FloatArray:
    """Combinations (k, m) whose unabsorbed rows are orthonormal; absorbed ones are left out."""
    scale = 1.0 / np.sqrt(energy)
    values, vectors = np.linalg.eigh(left * np.outer(scale, scale))
    kept = values > max(1e-4, 1e-6 * float(values.max(initial=0.0)))
    return np.asarray(scale[:, None] * vectors[:, kept] / np.sqrt(values[kept]))


def _measure(
    shaped: ShapedEffect,
    parts: Sequence[slice],
    remainder: _Remainder,
    needed: float,
    scale: JointScale,
) -> Detectability:
    """Of one effect; `needed`: energy beside the model at which it is seen."""
    effect = shaped.effect
    absorbed = []
    options: list[tuple[bool, float, str]] = []
    for shape, part in zip(shaped.shapes, parts, strict=True):
        rest = np.clip(np.diag(remainder.left)[part], 0.0, None)
        share = rest / remainder.energy[part]
        largest = remainder.largest[part]
        absorbed.append(1.0 - float(share.max()))
        if effect.size_in == "shape":
            if rest[0] >= needed and share[0] > 1.0 - settings.ABSORBED:
                words, plausible = _judged(effect, shape, np.ones(1), 0.0, scale)
                options.append((plausible, effect.size_of(shape), words))
            continue
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
    options.sort(key=lambda option: (not option[0], option[1]))
    if not options:
        return Detectability(float(np.median(absorbed)), min(absorbed), "", False)
    return Detectability(float(np.median(absorbed)), min(absorbed), options[0][2], options[0][0])


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


def shown_by_motion(
    data: Baseline,
    regression: Regression,
    catalogue: Sequence[Effect],
    noise_models: Sequence[AutoregressiveModel],
) -> tuple[tuple[Confusability, ...], tuple[NotTestable, ...]]:
    """Say what the motion can show and what it cannot.

    Parameters
    ----------
    regression
        Of the refit; only its regressor is used, not its torque.
    noise_models
        Noise of each joint, known beforehand or bounded from below (`floor_noise_models`).
    """
    covered = operating_range(data)
    absorption = Absorption(regression, noise_models)
    rows = [len(joint.torque) for joint in regression.joints]
    friction = _dry_friction(data, covered)
    tables, refused = [], []
    for joint, name in enumerate(data.joints):
        candidates: list[ShapedEffect] = []
        for effect in catalogue:
            for place in _places(effect, joint, len(data.joints)):
                reason = cannot_show(effect, joint, covered)
                made = None if reason else _shaped(data, effect, place, covered)
                if made is None:
                    reason = reason or "no shape of it is possible on this motion"
                    reason = data.unit_at(joint, reason)
                    needed = _TORQUE if joint in covered.left_out else effect.excitation
                    refused.append(NotTestable(effect.name, name, reason, needed))
                else:
                    candidates.append(made)
        if not candidates:
            continue
        scale = JointScale(covered, joint, friction[joint])
        measured, correlation = detectability(absorption, candidates, rows[joint], scale)
        for candidate, measure in zip(candidates, measured, strict=True):
            refusal = _refusal(candidate, measure, name)
            if refusal is not None:
                refused.append(
                    replace(
                        refusal,
                        reason=data.unit_at(joint, refusal.reason),
                        smallest=data.unit_at(joint, refusal.smallest),
                    )
                )
        tables.append(
            Confusability(
                joint=name,
                effects=tuple(candidate.effect.name for candidate in candidates),
                correlation=correlation,
                absorbed=np.array([measure.absorbed for measure in measured]),
                smallest=tuple(data.unit_at(joint, each.smallest) for each in measured),
            )
        )
    return tuple(tables), tuple(refused)


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
) -> ShapedEffect | None:
    shapes = spread_shapes(effect, place, covered)
    if not shapes:
        return None
    usable = [
        (shape, columns)
        for shape, columns in zip(shapes, rows_of(data, effect, place, shapes), strict=True)
        if all(np.max(np.abs(rows), initial=0.0) < _LARGEST_TORQUE for rows in columns.values())
    ]
    if not usable:
        return None
    return ShapedEffect(effect, place, [s for s, _ in usable], [c for _, c in usable])


def _refusal(candidate: ShapedEffect, measure: Detectability, joint: str) -> NotTestable | None:
    effect = candidate.effect
    if measure.least_absorbed > settings.ABSORBED:
        share = 100.0 * measure.least_absorbed
        reason = f"the model's own parameters absorb {share:.1f} % of it on this motion"
        return NotTestable(effect.name, joint, reason, effect.excitation)
    if not measure.smallest:
        reason = "its torque stays within the noise at every size that was tried"
        return NotTestable(effect.name, joint, reason, effect.excitation)
    if not measure.plausible:
        reason = f"only sizes from {measure.smallest} would be seen, and smaller ones are common"
        return NotTestable(effect.name, joint, reason, effect.excitation, measure.smallest)
    return None


def _dry_friction(data: Baseline, covered: OperatingRange) -> list[float]:
    """Dry friction of each joint, N m (N): of the refit, or a share of the peak if it has none."""
    levels = data.prepared.model.dynamic_parameters(data.estimate.linear.values).coulomb
    return [
        float(level)
        if level > settings.LEAST_DRY_FRICTION * peak
        else _ASSUMED_DRY_FRICTION * float(peak)
        for level, peak in zip(levels, covered.torque, strict=True)
    ]
