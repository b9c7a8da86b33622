"""Which effects a recording can show, from its motion alone: before torque is looked at."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.gap.baseline import Baseline
from idim_iv_ros.gap.effects.effect import Effect, Extent, Place, Shape
from idim_iv_ros.gap.joint_units import unit_at
from idim_iv_ros.gap.likelihood import Colour, Columns, Fit, Regression, Scan
from idim_iv_ros.gap.motion_limits import cannot_show
from idim_iv_ros.gap.result import Confusability, EffectParameter, NotTestable
from idim_iv_ros.gap.search import extent, rows_of

FloatArray = NDArray[np.float64]

# Noncentrality of a chi-square at which an effect is seen (gap.md), and the share of the rows'
# energy below which no effect is accepted.
_NONCENTRALITY = 20.0
_LEAST_SHARE = 0.01
_ABSORBED = 0.995
_SHAPES = 4
# Stribeck speeds of arms are 0.02 to 0.3 rad/s: a joint must move beyond their middle, and
_TINY = 1e-12


@dataclass(frozen=True)
class Plausible:
    """Size of an effect that a recording should be able to show.

    Attributes
    ----------
    limit : float
    of : str
        ``dry``: its largest torque over the joint's dry friction; ``peak``: over the largest
        torque; ``size``: its largest coefficient; else the parameter with this name, in its unit.
    """

    limit: float
    of: str


# The middle (geometric) of what is typical of arms: an effect of which only larger sizes would be
# seen may well be there without a trace.
PLAUSIBLE: dict[str, Plausible] = {
    "stribeck": Plausible(0.2, "dry"),  # static over dry friction 1.05 to 1.6
    "nonlinear_viscous": Plausible(0.5, "dry"),
    "asymmetric_friction": Plausible(0.1, "dry"),  # 5 to 20 %
    "load_dependent_friction": Plausible(0.1, "driving"),  # 3 to 40 %
    "position_dependent_friction": Plausible(0.1, "dry"),  # 5 to 15 %
    "friction_drift": Plausible(0.4, "dry"),  # 30 to 60 %
    "presliding": Plausible(0.5, "dry"),
    "backlash": Plausible(0.001, "gap"),  # 0.1 to 10 mrad
    "time_delay": Plausible(0.002, "delay"),  # 0.25 to 20 ms
    "torque_saturation": Plausible(0.05, "peak"),  # 0 to 15 %
    "position_ripple": Plausible(0.015, "peak"),  # 0.5 to 3 %
    "spring": Plausible(0.1, "peak"),
    "encoder_eccentricity": Plausible(0.002, "size"),  # 0.01 to 5 mrad
    "joint_coupling": Plausible(0.5, "dry"),
}
_SOFTEST = 11.0  # Hz, resonance of the link: 5 to 25 Hz
_MOST_SCALED = 1.5  # a shaft or a delay is scaled down, but no further up than this
_LARGEST = 1e6  # N m: columns beyond come from a transmission that ran away
# Effects whose coefficient is one: their size is in the shape.
_SHAPED = ("backlash",)
_SCALED = ("elasticity", "time_delay")


@dataclass(frozen=True)
class _Candidate:
    """One effect at one place, with the columns of a few shapes side by side."""

    effect: Effect
    place: Place
    shapes: list[Shape]
    columns: list[Columns]


@dataclass(frozen=True)
class _Measure:
    """What the motion tells of one candidate."""

    absorbed: float
    least_absorbed: float
    smallest: str
    plausible: bool


def shown_by_motion(
    data: Baseline,
    regression: Regression,
    catalogue: Sequence[Effect],
    colours: Sequence[Colour],
    dry_friction: Sequence[float],
) -> tuple[tuple[Confusability, ...], tuple[NotTestable, ...]]:
    """Say what the motion can show and what it cannot.

    Parameters
    ----------
    regression
        Of the refit; only its regressor is used, not its torque.
    colours
        Noise of each joint, known beforehand or bounded from below (`floor_colours`).
    dry_friction
        N m (N), of each joint: the scale of what is plausible.
    """
    covered = extent(data)
    scan = Scan(regression, _without_torque(regression, colours))
    rows = [len(joint.torque) for joint in regression.joints]
    tables, refused = [], []
    for joint, name in enumerate(data.joints):
        candidates = []
        for effect in catalogue:
            for place in _places(effect, joint, len(data.joints)):
                reason = cannot_show(effect.name, joint, covered)
                made = None if reason else _candidate(data, effect, place, covered)
                if made is None:
                    reason = reason or "no shape of it is possible on this motion"
                    reason = unit_at(data, joint, reason)
                    refused.append(NotTestable(effect.name, name, reason, effect.excitation))
                else:
                    candidates.append(made)
        if not candidates:
            continue
        measured, correlation = _measured(
            scan, candidates, covered, joint, rows[joint], dry_friction[joint]
        )
        for candidate, measure in zip(candidates, measured, strict=True):
            refusal = _refusal(candidate, measure, name)
            if refusal is not None:
                refused.append(
                    replace(
                        refusal,
                        reason=unit_at(data, joint, refusal.reason),
                        smallest=unit_at(data, joint, refusal.smallest),
                    )
                )
        tables.append(
            Confusability(
                joint=name,
                effects=tuple(candidate.effect.name for candidate in candidates),
                correlation=correlation,
                absorbed=np.array([measure.absorbed for measure in measured]),
                smallest=tuple(unit_at(data, joint, each.smallest) for each in measured),
            )
        )
    return tuple(tables), tuple(refused)


def floor_colours(fit: Fit, sigmas: Sequence[float | None]) -> tuple[Colour, ...]:
    """Colours of a fit with the standard deviations of the noise floor where it is smaller."""
    return tuple(
        Colour(colour.model, colour.sigma if sigma is None else min(sigma, colour.sigma))
        for colour, sigma in zip(fit.colours, sigmas, strict=True)
    )


def dry_friction(data: Baseline) -> tuple[float, ...]:
    """Dry friction of each joint from the refit, N m (N); 5 % of the peak where it has none."""
    covered = extent(data)
    levels = data.prepared.model.dynamic_parameters(data.estimate.linear.values).coulomb
    return tuple(
        float(level) if level > 0.01 * peak else 0.05 * float(peak)
        for level, peak in zip(levels, covered.torque, strict=True)
    )


def _without_torque(regression: Regression, colours: Sequence[Colour]) -> Fit:
    """Colours alone: nothing of the torque enters."""
    return Fit(
        values=np.zeros(regression.parameters),
        coefficients=np.zeros(0),
        covariance=np.zeros((0, 0)),
        colours=tuple(colours),
        residuals=tuple(np.zeros(len(rows.torque)) for rows in regression.joints),
        log_likelihood=0.0,
    )


def _places(effect: Effect, joint: int, joints: int) -> list[Place]:
    """Places at a joint; of pairs the one with the next joint."""
    places = [place for place in effect.places(joints) if place.joint == joint]
    return places[:1]


def _candidate(data: Baseline, effect: Effect, place: Place, covered: Extent) -> _Candidate | None:
    grid = effect.grid(place, covered)
    if not grid:
        return None
    spread = np.unique(np.linspace(0, len(grid) - 1, _SHAPES).round().astype(int))
    shapes = [grid[k] for k in spread]
    usable = [
        (shape, columns)
        for shape, columns in zip(shapes, rows_of(data, effect, place, shapes), strict=True)
        if all(np.max(np.abs(rows), initial=0.0) < _LARGEST for rows in columns.values())
    ]
    if not usable:
        return None
    return _Candidate(effect, place, [s for s, _ in usable], [c for _, c in usable])


def _measured(
    scan: Scan,
    candidates: Sequence[_Candidate],
    covered: Extent,
    joint: int,
    rows: int,
    dry: float,
) -> tuple[list[_Measure], FloatArray]:
    """Measure all candidates of one joint from one product of all their columns."""
    blocks = [columns for candidate in candidates for columns in candidate.columns]
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
    white = scan.whiten(stacked)
    energy = np.maximum(scan.energy(white), _TINY)
    left = scan.normal(white, white)
    own = stacked.get(joint)
    largest = np.zeros(len(energy)) if own is None else np.abs(own).max(axis=0)
    needed = max(_NONCENTRALITY, _LEAST_SHARE * rows)
    ends = np.cumsum(widths)
    slices = [slice(int(e) - w, int(e)) for e, w in zip(ends, widths, strict=True)]
    groups, bases, start = [], [], 0
    for candidate in candidates:
        own_slices = slices[start : start + len(candidate.shapes)]
        start += len(candidate.shapes)
        groups.append(
            _measure(candidate, own_slices, energy, left, largest, needed, (covered, joint, dry))
        )
        bases.append([(part, _basis(left[part, part], energy[part])) for part in own_slices])
    correlation = np.eye(len(candidates))
    for a in range(len(candidates)):
        for b in range(a):
            values = [
                np.linalg.norm(one.T @ left[first, second] @ two, 2)
                for first, one in bases[a]
                for second, two in bases[b]
                if one.size and two.size
            ]
            correlation[a, b] = correlation[b, a] = min(max(values, default=0.0), 1.0)
    return groups, correlation


def _basis(left: FloatArray, energy: FloatArray) -> FloatArray:
    """Combinations (k, m) whose unabsorbed rows are orthonormal; absorbed ones are left out."""
    scale = 1.0 / np.sqrt(energy)
    values, vectors = np.linalg.eigh(left * np.outer(scale, scale))
    kept = values > max(1e-4, 1e-6 * float(values.max(initial=0.0)))
    return np.asarray(scale[:, None] * vectors[:, kept] / np.sqrt(values[kept]))


def _measure(
    candidate: _Candidate,
    slices: Sequence[slice],
    energy: FloatArray,
    left: FloatArray,
    largest: FloatArray,
    needed: float,
    joint: tuple[Extent, int, float],
) -> _Measure:
    absorbed = []
    options: list[tuple[bool, float, str]] = []
    for shape, part in zip(candidate.shapes, slices, strict=True):
        rest = np.clip(np.diag(left)[part], 0.0, None)
        share = rest / energy[part]
        absorbed.append(1.0 - float(share.max()))
        if candidate.effect.name in _SHAPED:
            if rest[0] >= needed and share[0] > 1.0 - _ABSORBED:
                words, plausible = _judged(candidate, shape, np.ones(1), 0.0, joint)
                options.append((plausible, float(shape[0]), words))
            continue
        size = np.sqrt(needed / np.maximum(rest, _TINY))
        size[(share < 1.0 - _ABSORBED) | (largest[part] <= 0.0)] = np.inf
        if candidate.effect.name in _SCALED:
            size[size > _MOST_SCALED] = np.inf
        k = int(np.argmin(size * np.maximum(largest[part], _TINY)))
        if not np.isfinite(size[k]):
            continue
        coefficients = np.zeros(len(size))
        coefficients[k] = size[k]
        torque = float(size[k] * largest[part][k])
        words, plausible = _judged(candidate, shape, coefficients, torque, joint)
        options.append((plausible, torque, words))
    options.sort(key=lambda option: (not option[0], option[1]))
    if not options:
        return _Measure(float(np.median(absorbed)), min(absorbed), "", False)
    return _Measure(float(np.median(absorbed)), min(absorbed), options[0][2], options[0][0])


def _judged(
    candidate: _Candidate,
    shape: Shape,
    coefficients: FloatArray,
    torque: float,
    joint: tuple[Extent, int, float],
) -> tuple[str, bool]:
    """Size in words, and whether effects of this size are plausible."""
    covered, number, dry = joint
    effect = candidate.effect
    found = effect.parameters(shape, coefficients, np.zeros(len(coefficients)))
    words = _in_words(found, torque)
    if effect.name == "elasticity":
        softest = float(covered.inertia[number]) * (2.0 * np.pi * _SOFTEST) ** 2
        stiffness = found["stiffness"].value
        return f"stiffness {stiffness:.2g} N m/rad", bool(stiffness >= softest)
    limit = PLAUSIBLE.get(effect.name)
    if limit is None:
        return words, True
    if limit.of == "dry":
        return words, torque <= limit.limit * dry
    if limit.of == "peak":
        return words, torque <= limit.limit * float(covered.torque[number])
    if limit.of == "size":
        return words, bool(np.max(np.abs(coefficients)) <= limit.limit)
    value = max(p.value for name, p in found.items() if name in (limit.of, "driven"))
    return words, value <= limit.limit


_WORDS: tuple[str, ...] = (
    "gap", "delay", "slope", "driving", "excess", "offset", "height", "sine_1", "cosine_1",
    "level_1", "coulomb", "viscous", "coefficient", "constant", "linear", "quadratic", "cubic",
    "bent", "sine", "cosine", "sine_2", "cosine_2", "driven",
)  # fmt: skip


def _in_words(found: dict[str, EffectParameter], torque: float) -> str:
    """The first parameter that is not zero, with its unit."""
    for name in _WORDS:
        if name in found and found[name].value != 0.0:
            unit = f" {found[name].unit}" if found[name].unit else ""
            plain = found[name].unit == "N m" or torque <= 0.0
            more = "" if plain else f" (up to {torque:.2g} N m)"
            return f"{name.replace('_', ' ')} = {found[name].value:.2g}{unit}{more}"
    return f"{torque:.2g} N m"


def _refusal(candidate: _Candidate, measure: _Measure, joint: str) -> NotTestable | None:
    effect = candidate.effect
    if measure.least_absorbed > _ABSORBED:
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
