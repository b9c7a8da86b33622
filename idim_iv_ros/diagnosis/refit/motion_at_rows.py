"""The smooth motion at the instants of one joint's rows."""

from collections.abc import Sequence
from dataclasses import dataclass

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.since_reversal import since_reversal
from idim_iv_ros.types import FloatArray


@dataclass(frozen=True)
class MotionAtRows:
    """What one joint does at its rows, over all recordings; (r,) each.

    Attributes
    ----------
    time : s
    position, velocity : rad, rad/s (m, m/s)
    load : N m (N)
        Torque of the rigid bodies alone.
    since_reversal : rad (m)
        Distance since the last reversal.
    """

    time: FloatArray
    position: FloatArray
    velocity: FloatArray
    load: FloatArray
    since_reversal: FloatArray


def motion_at_rows(data: Baseline, joint: int) -> MotionAtRows:
    """Take the smooth motion of one joint at the rows that count."""
    motions = data.motions
    slowest = settings.REVERSAL_SPEED * float(data.slowest[joint])

    def at_rows(values: Sequence[FloatArray]) -> FloatArray:
        kept = [part[each.decimation.kept] for part, each in zip(values, motions, strict=True)]
        return data.counting(joint, kept)

    return MotionAtRows(
        time=at_rows([each.time for each in motions]),
        position=at_rows([each.position[:, joint] for each in motions]),
        velocity=at_rows([each.velocity[:, joint] for each in motions]),
        load=at_rows([each.load[:, joint] for each in motions]),
        since_reversal=at_rows(
            [
                since_reversal(each.position[:, joint], each.velocity[:, joint], slowest)
                for each in motions
            ]
        ),
    )
