"""In which order causes are told."""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.gap.baseline import Baseline
from idim_iv_ros.gap.result import Cause


def strongest_first(causes: Sequence[Cause], data: Baseline) -> list[Cause]:
    """Structural causes by their evidence, parametric ones by the gap that they close.

    The kind that holds the cause that closes most of the gap comes first.
    """
    structural = [cause for cause in causes if cause.kind == "structural"]
    parametric = [cause for cause in causes if cause.kind == "parametric"]
    structural.sort(key=lambda cause: -cause.evidence.statistic)
    parametric.sort(key=lambda cause: -_closed(cause, data))
    groups = sorted(
        [structural, parametric],
        key=lambda group: -max((_closed(cause, data) for cause in group), default=0.0),
    )
    return [*groups[0], *groups[1]]


def _closed(cause: Cause, data: Baseline) -> float:
    """Energy of the torque gap that a cause closes, as a share of the torque's."""
    closed = cause.torque_gap.before**2 - cause.torque_gap.after**2
    joints = range(len(data.joints)) if cause.joint is None else [data.joints.index(cause.joint)]
    whole = sum(float(np.mean(data.rows[joint].torque ** 2)) for joint in joints)
    return closed / max(whole, 1e-300)
