"""The order of the causes, the verdict in one word, and the summary in one paragraph."""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import Cause, JointGap, Unexplained, Verdict
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


def verdict_of(
    causes: Sequence[Cause],
    rest: Unexplained | None,
    *,
    parameters: bool = False,
    unexplained: bool = False,
) -> Verdict:
    """One word: named causes count before what has no name.

    Parameters
    ----------
    parameters
        Whether new parameters take a part of the gap that no cause names: that they are in error is
        known, which of them is not.
    unexplained
        Whether much of the gap stays.
    """
    kinds: set[str] = {cause.kind for cause in causes}
    if parameters and not kinds and not unexplained:
        kinds = {"parametric"}
    if kinds == {"parametric", "structural"}:
        return "both"
    if "parametric" in kinds:
        return "parametric" if rest is None else "unknown"
    if "structural" in kinds:
        return "structural"
    return "unknown" if unexplained or rest is not None else "none"


def summary_of(
    verdict: Verdict,
    causes: Sequence[Cause],
    rest: Unexplained | None,
    gaps: Sequence[JointGap],
    without: Sequence[str],
    left: str = "",
    *,
    numbers: str = "",
    more: int = 0,
    model: str = "nominal model",
) -> str:
    """One paragraph that a robot engineer can act on.

    Parameters
    ----------
    causes
        Those to be told.
    left
        What the last model still misses, in words.
    numbers
        Wrong given numbers that no cause tells, in words.
    more
        How many smaller causes there are.
    model
        Whose gaps they are, in words.
    """
    sentences = []
    worst = max(gaps, key=lambda gap: gap.share, default=None)
    if worst is not None and worst.relative_percent is not None:
        sentences.append(
            f"The {model} misses {worst.relative_percent:.3g} % of the torque at "
            f"{worst.joint}, where the gap is widest."
        )
    if verdict == "none":
        sentences.append(
            "No effect of the catalogue explains more of it than chance: what is left is noise, or "
            "too small for these recordings to show."
        )
    for cause in causes:
        sentences.append(cause.sentence[0].upper() + cause.sentence[1:] + ".")
    if more:
        others = "1 smaller cause is" if more == 1 else f"{more} smaller causes are"
        sentences.append(f"{others} listed beside these.")
    if numbers:
        sentences.append(numbers)
    if rest is not None:
        sentences.append(
            f"Not in the catalogue: {rest.where}"
            + (
                "."
                if rest.family == "event"  # said in `where`
                else f"; it holds {100 * rest.share:.0f} % of what the refit leaves there."
            )
        )
    if left:
        sentences.append(left)
    if without:
        sentences.append(f"Left out of the catalogue on request: {', '.join(without)}.")
    return " ".join(sentences)
