"""Rows of an effect at a place, and what the recordings cover."""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.diagnosis.likelihood import Columns, width_of
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.smooth_motion import SmoothMotion
from idim_iv_ros.effects.effect import Effect, OperatingRange, Place, Shape
from idim_iv_ros.types import FloatArray

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
