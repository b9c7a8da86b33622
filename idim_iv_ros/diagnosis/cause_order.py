"""In which order causes are listed."""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import Cause
from idim_iv_ros.effects.controller_mismatch import ControllerMismatch
from idim_iv_ros.effects.drive_inertia import DriveInertia


def strongest_first(causes: Sequence[Cause], data: Baseline) -> list[Cause]:
    """Sort causes by the gap that they take, as a share of the torque of its joint.

    Of causes that move several joints the shares of all count. Another control law has no gap of
    the torque: its evidence decides whether it comes before the structural causes or after them.
    Drive inertia that the configuration leaves out stands before all: it was known to be missing.
    """
    laws = [cause for cause in causes if cause.effect == ControllerMismatch.name]
    others = [cause for cause in causes if cause.effect != ControllerMismatch.name]
    others.sort(key=lambda cause: -_taken(cause, data))
    structural = [place for place, cause in enumerate(others) if cause.kind == "structural"]
    place = structural[-1] + 1 if structural else len(others)
    if structural and _most_evidence(laws) > _most_evidence([others[each] for each in structural]):
        place = structural[0]
    ordered = [*others[:place], *laws, *others[place:]]
    return sorted(ordered, key=lambda cause: not _left_out(cause))


def leading(causes: Sequence[Cause], data: Baseline) -> list[Cause]:
    """Return the causes that take most of the gap, in the order in which they are listed."""
    most = settings.MOST_CAUSES_IN_SUMMARY
    widest = sorted(causes, key=lambda cause: -_taken(cause, data))[:most]
    return [cause for cause in causes if any(cause is each for each in widest)]


def _left_out(cause: Cause) -> bool:
    return cause.effect == DriveInertia.name and cause.joint is None


def _most_evidence(group: Sequence[Cause]) -> float:
    return max((cause.evidence.statistic for cause in group), default=0.0)


def _taken(cause: Cause, data: Baseline) -> float:
    """Energy of the torque gap that a cause takes, as a share of the torque's, over its joints."""
    if cause.joint_gaps:
        return sum(
            float(np.sign(each.share_of_torque)) * each.share_of_torque**2
            for each in cause.joint_gaps
        )
    taken = cause.torque_gap.before**2 - cause.torque_gap.after**2
    joints = range(len(data.joints)) if cause.joint is None else [data.joints.index(cause.joint)]
    whole = sum(float(np.mean(data.rows[joint].torque ** 2)) for joint in joints)
    return taken / max(whole, 1e-300)
