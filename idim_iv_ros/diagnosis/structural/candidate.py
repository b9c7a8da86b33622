"""An effect at a place: the rows that it adds, and its numbers with standard deviations.

Deviations hold what the shape leaves open. With it held, an excess of friction is known to a
percent; a Stribeck speed that is a little higher with less excess fits as well. The shape is moved
a little in every direction that the search may take, the change of the torque is fitted beside
everything else, and the covariance of all is carried over to the numbers that an engineer reads.
The search ends on a grid: how far the fit would still move a number counts as its error, too.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.diagnosis.likelihood import Columns, Fit, Regression, width_of
from idim_iv_ros.diagnosis.refit.baseline import Baseline, with_parameters
from idim_iv_ros.diagnosis.refit.smooth_motion import SmoothMotion
from idim_iv_ros.diagnosis.result import EffectParameter
from idim_iv_ros.effects.effect import Effect, OperatingRange, Place, Shape
from idim_iv_ros.types import FloatArray

_SHAPE_STEP = 0.01  # of the number of a shape
_COEFFICIENT_STEP = 1e-4  # of the coefficient

_SPREAD_SHAPES = 4  # of a grid, by which an effect is judged from the motion alone
_PRISMATIC_LEVER = 0.1  # m: what counts as a radian of a prismatic joint
_AT_ONCE = 32  # shapes: their columns together stay small


def operating_range(data: Baseline) -> OperatingRange:
    """What the recordings cover."""
    motions = data.motions
    kinds = data.prepared.model.robot.joint_types
    speed = np.max([np.abs(m.velocity).max(axis=0) for m in motions], axis=0)
    return OperatingRange(
        low=np.min([m.position.min(axis=0) for m in motions], axis=0),
        high=np.max([m.position.max(axis=0) for m in motions], axis=0),
        slowest=data.slowest,
        fastest=np.asarray(speed),
        load=np.max([np.abs(m.load).max(axis=0) for m in motions], axis=0),
        torque=np.max([np.abs(m.torque).max(axis=0) for m in motions], axis=0),
        inertia=np.mean([np.einsum("sii->i", m.inertia) / len(m.time) for m in motions], axis=0),
        duration=float(max(m.time[-1] for m in motions)),
        longest=float(max(m.elapsed[-1] for m in motions)),
        row_rate=data.row_rate,
        lever=np.array([1.0 if kind == "revolute" else _PRISMATIC_LEVER for kind in kinds]),
        sticking=data.sticking,
        left_out=data.left_out,
    )


def spread_shapes(effect: Effect, place: Place, covered: OperatingRange) -> list[Shape]:
    """Return a few shapes from all over the effect's grid; none where no shape is possible."""
    grid = effect.grid(place, covered)
    if not grid:
        return []
    return [
        grid[k]
        for k in np.unique(np.linspace(0, len(grid) - 1, _SPREAD_SHAPES).round().astype(int))
    ]


def rows_of(data: Baseline, effect: Effect, place: Place, shapes: Sequence[Shape]) -> list[Columns]:
    """Rows of the regression for each shape; many shapes are decimated at once.

    Columns of shapes that follow each other lie one after the other in memory.
    """
    made: list[Columns] = []
    for start in range(0, len(shapes), _AT_ONCE):
        made += _rows_at_once(data, effect, place, shapes[start : start + _AT_ONCE])
    return made


def _rows_at_once(
    data: Baseline, effect: Effect, place: Place, shapes: Sequence[Shape]
) -> list[Columns]:
    """Rows for a few shapes, all columns of all joints filtered in one call."""
    tables = []
    for motion in data.motions:
        joints, widths, lines = _side_by_side(effect, motion, place, shapes)
        tables.append(motion.rows(lines.T).T)
    ends = np.cumsum(widths)
    blocks: list[dict[int, FloatArray]] = [{} for _ in shapes]
    for number, joint in enumerate(joints):
        own = slice(number * ends[-1], (number + 1) * ends[-1])
        counting = [
            table[own].compress(motion.kept[:, joint], axis=1)
            for table, motion in zip(tables, data.motions, strict=True)
        ]
        rows = np.concatenate(counting, axis=1)
        for block, end, width in zip(blocks, ends, widths, strict=True):
            block[joint] = rows[end - width : end].T
    return list(blocks)


def _side_by_side(
    effect: Effect, motion: SmoothMotion, place: Place, shapes: Sequence[Shape]
) -> tuple[tuple[int, ...], list[int], FloatArray]:
    """Joints of an effect, columns of each shape, and all of these as lines (joints × k, s).

    The effect's own arrays are free again before the lines are filtered.
    """
    torques = effect.torques(motion, place, shapes)
    joints = tuple(torques[0])
    lines = np.concatenate([torque[joint].T for joint in joints for torque in torques])
    return joints, [width_of(torque) for torque in torques], lines


@dataclass(frozen=True)
class Candidate:
    """An effect at a place with its best shape, beside a model.

    Attributes
    ----------
    effect : Effect
    place : Place
    shape : Shape
    columns : Columns
        Rows (r_j, k) by joint.
    coefficients : (k,)
        Of its columns.
    residuals : by joint (r_j,)
        At its own joints, with the candidate in the model, N m (N).
    gain : float
        Of the logarithm of the likelihood, with the noise models of a fit that has it.
    explained : float
        Share of the torque gap's energy at its joints that it takes away, not whitened.
    """

    effect: Effect
    place: Place
    shape: Shape
    columns: Columns
    coefficients: FloatArray
    residuals: Columns
    gain: float
    explained: float

    @property
    def width(self) -> int:
        """How many columns it has."""
        return int(next(iter(self.columns.values())).shape[1])

    def share_of_torque(self, sizes: Sequence[float]) -> float:
        """RMS of the gap that it explains at its joint, as a share of that joint's torque `sizes`.

        Not of its own torque: a free curve of the speed holds the dry friction that the model has.
        """
        joint = self.place.joint
        after = float(np.mean(self.residuals[joint] ** 2))
        share = min(max(self.explained, 0.0), 1.0 - 1e-9)
        return float(np.sqrt(after * share / (1.0 - share))) / sizes[joint]


def parameters_of(
    data: Baseline, regression: Regression, fit: Fit, candidate: Candidate, start: int
) -> dict[str, EffectParameter]:
    """Parameters of one effect among all that were added.

    Parameters
    ----------
    regression, fit
        With all effects.
    candidate
        The effect.
    start
        Place of its first column among the added ones.
    """
    effect, shape = candidate.effect, candidate.shape
    free = _with_free_shape(data, regression, fit, candidate, start)
    coefficients = fit.coefficients[start : start + candidate.width]
    found = effect.parameters(shape, coefficients, free.held)
    if not free.near:
        return found
    slopes = _slopes(effect, shape, coefficients, free.held, free.near)
    variances = np.einsum("pi,ij,pj->p", slopes, free.covariance, slopes)
    variances += (slopes @ free.further) ** 2
    return {
        name: EffectParameter(
            each.value, float(np.sqrt(max(variance, 0.0))) if slope.any() else None, each.unit
        )
        for (name, each), slope, variance in zip(found.items(), slopes, variances, strict=True)
    }


@dataclass(frozen=True)
class _FreeShape:
    """Coefficients of an effect (k,) beside moves of its shape (m,).

    Attributes
    ----------
    near : list of Shape
        One for each move.
    held : (k,)
        Deviations with the shape held.
    covariance : (k + m, k + m)
    further : (k + m,)
        How far the fit would still move each.
    """

    near: list[Shape]
    held: FloatArray
    covariance: FloatArray
    further: FloatArray


def _with_free_shape(
    data: Baseline, regression: Regression, fit: Fit, candidate: Candidate, start: int
) -> _FreeShape:
    effect, shape = candidate.effect, candidate.shape
    own = np.arange(start, start + candidate.width)
    coefficients = fit.coefficients[own]
    inner = fit.coefficient_covariance[np.ix_(own, own)]
    held = np.sqrt(np.maximum(np.diag(inner), 0.0))
    near = _near(effect, shape, candidate.place, operating_range(data)) if effect.free_shape else []
    if not near:
        return _FreeShape([], held, inner, np.zeros(len(own)))
    # Of the torque that the fit leaves to the model, as `knee` has it.
    own_torque = with_parameters(data, fit.values) if effect.beyond_knee else data
    here, *moved = rows_of(own_torque, effect, candidate.place, [shape, *near])
    changes = {
        joint: np.column_stack([(rows[joint] - here[joint]) @ coefficients for rows in moved])
        for joint in here
    }
    wider = regression.with_columns(changes).fit(fit.noise_models, steps=0)
    places = np.concatenate([own, len(wider.coefficients) - len(near) + np.arange(len(near))])
    further = wider.coefficients[places]
    further[: len(own)] -= coefficients
    covariance = wider.coefficient_covariance[np.ix_(places, places)]
    return _FreeShape(near, held, covariance, further)


def _near(effect: Effect, shape: Shape, place: Place, covered: OperatingRange) -> list[Shape]:
    """One neighbour for each number, or numbers that move together, of the shape."""
    kept: dict[tuple[int, ...], Shape] = {}
    for near in effect.neighbours(shape, _SHAPE_STEP, place, covered):
        pairs = zip(near.numbers, shape.numbers, strict=True)
        moved = tuple(k for k, (a, b) in enumerate(pairs) if a != b)
        if moved:
            kept.setdefault(moved, near)
    return list(kept.values())


def _slopes(
    effect: Effect,
    shape: Shape,
    coefficients: FloatArray,
    held: FloatArray,
    near: Sequence[Shape],
) -> FloatArray:
    """Change of each parameter (p, k + m) with each coefficient and with each move of the shape."""

    def values(shape: Shape, coefficients: FloatArray) -> FloatArray:
        found = effect.parameters(shape, coefficients, np.zeros(len(coefficients)))
        return np.array([each.value for each in found.values()])

    here = values(shape, coefficients)
    slopes = []
    for k, size in enumerate(np.maximum(np.abs(coefficients), held)):
        step = _COEFFICIENT_STEP * max(float(size), 1e-12)
        changed = coefficients.copy()
        changed[k] += step
        slopes.append((values(shape, changed) - here) / step)
    slopes += [values(other, coefficients) - here for other in near]
    return np.column_stack(slopes)
