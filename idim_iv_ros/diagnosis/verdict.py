"""The verdict in one word, and the order of the causes."""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import Cause, Unexplained, Verdict
from idim_iv_ros.effects.registry import BY_NAME


def strongest_first(causes: Sequence[Cause], data: Baseline) -> list[Cause]:
    """Sort causes by what they take of the gap, as a share of the torque of the joint.

    Of causes that move several joints the shares of all count. Another control law has no gap of
    the torque: its evidence decides whether it comes before the structural causes or after them.
    What was put in before anything else was looked for comes first: drive inertia that the
    configuration leaves out, and a delay of all joints.
    """
    laws = [cause for cause in causes if BY_NAME[cause.effect].part == "gains"]
    others = [cause for cause in causes if BY_NAME[cause.effect].part != "gains"]
    others.sort(key=lambda cause: -_taken(cause, data))
    structural = [place for place, cause in enumerate(others) if cause.kind == "structural"]
    place = structural[-1] + 1 if structural else len(others)
    if structural and _most_evidence(laws) > _most_evidence([others[each] for each in structural]):
        place = structural[0]
    ordered = [*others[:place], *laws, *others[place:]]
    return sorted(ordered, key=lambda cause: not _put_in_first(cause))


def _put_in_first(cause: Cause) -> bool:
    return BY_NAME[cause.effect].put_in_first and cause.joint is None


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


def verdict_of(
    causes: Sequence[Cause],
    outside: Unexplained | None,
    *,
    parameters: bool = False,
    unexplained: bool = False,
) -> Verdict:
    """One word: causes of the catalogue count before what is outside it.

    Parameters
    ----------
    parameters
        Whether parameters are in error beyond the causes: it is not known which.
    unexplained
        Whether much of the gap remains.
    """
    kinds: set[str] = {cause.kind for cause in causes}
    if parameters and not kinds and not unexplained:
        kinds = {"parametric"}
    if kinds == {"parametric", "structural"}:
        return "both"
    if "parametric" in kinds:
        return "parametric" if outside is None else "unknown"
    if "structural" in kinds:
        return "structural"
    return "unknown" if unexplained or outside is not None else "none"
