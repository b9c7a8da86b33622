"""What the recordings cover, and the rows that an effect adds to the regression there."""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.structural.likelihood import Columns
from idim_iv_ros.effects.effect import Effect, OperatingRange, Place, Shape
from idim_iv_ros.types import FloatArray


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
        row_rate=data.row_rate,
        lever=np.array([1.0 if kind == "revolute" else settings.PRISMATIC_LEVER for kind in kinds]),
        sticking=data.sticking,
    )


def spread_shapes(effect: Effect, place: Place, covered: OperatingRange) -> list[Shape]:
    """Return a few shapes from all over the effect's grid; none where no shape is possible."""
    grid = effect.grid(place, covered)
    if not grid:
        return []
    return [
        grid[k]
        for k in np.unique(
            np.linspace(0, len(grid) - 1, settings.SPREAD_SHAPES).round().astype(int)
        )
    ]


def rows_of(data: Baseline, effect: Effect, place: Place, shapes: Sequence[Shape]) -> list[Columns]:
    """Rows of the regression for each shape; all shapes are decimated at once."""
    made = [[effect.columns(motion, place, shape) for shape in shapes] for motion in data.motions]
    blocks: list[dict[int, FloatArray]] = [{} for _ in shapes]
    for joint in made[0][0]:
        rows = data.counting(
            joint,
            [
                motion.rows(np.vstack([columns[joint].T for columns in per_motion]).T)
                for motion, per_motion in zip(data.motions, made, strict=True)
            ],
        )
        start = 0
        for block, columns in zip(blocks, made[0], strict=True):
            width = columns[joint].shape[1]
            block[joint] = rows[:, start : start + width]
            start += width
    return list(blocks)
