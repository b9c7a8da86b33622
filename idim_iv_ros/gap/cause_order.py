"""In which order causes are told."""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.gap.baseline import Baseline
from idim_iv_ros.gap.effects.controller_mismatch import ControllerMismatch
from idim_iv_ros.gap.effects.drive_inertia import DriveInertia
from idim_iv_ros.gap.result import Cause


def strongest_first(causes: Sequence[Cause], data: Baseline) -> list[Cause]:
    """Structural causes in the order of their stages, parametric ones by the gap that they close.

    Each stage is the effect that closed most of the gap when it was accepted. Another control law
    has no stage: its evidence decides whether it comes before them or after. The kind that holds
    the cause that closes most of the gap comes first. Drive inertia that the configuration leaves
    out stands before all: it was known to be missing.
    """
    structural = [cause for cause in causes if cause.kind == "structural"]
    parametric = [cause for cause in causes if cause.kind == "parametric"]
    laws = [cause for cause in structural if cause.effect == ControllerMismatch.name]
    staged = [cause for cause in structural if cause.effect != ControllerMismatch.name]
    if _most_evidence(laws) > _most_evidence(staged):
        structural = [*laws, *staged]
    else:
        structural = [*staged, *laws]
    parametric.sort(key=lambda cause: -_closed(cause, data))
    groups = sorted(
        [structural, parametric],
        key=lambda group: -max((_closed(cause, data) for cause in group), default=0.0),
    )
    return sorted([*groups[0], *groups[1]], key=lambda cause: not _left_out(cause))


def leading(causes: Sequence[Cause], data: Baseline, most: int = 4) -> list[Cause]:
    """Return the causes that close most of the gap, in the order in which they stand."""
    widest = sorted(causes, key=lambda cause: -_closed(cause, data))[:most]
    return [cause for cause in causes if any(cause is each for each in widest)]


def _left_out(cause: Cause) -> bool:
    return cause.effect == DriveInertia.name and cause.joint is None


def _most_evidence(group: Sequence[Cause]) -> float:
    return max((cause.evidence.statistic for cause in group), default=0.0)


def _closed(cause: Cause, data: Baseline) -> float:
    """Energy of the torque gap that a cause closes, as a share of the torque's."""
    closed = cause.torque_gap.before**2 - cause.torque_gap.after**2
    joints = range(len(data.joints)) if cause.joint is None else [data.joints.index(cause.joint)]
    whole = sum(float(np.mean(data.rows[joint].torque ** 2)) for joint in joints)
    return closed / max(whole, 1e-300)
