"""One verdict against one label: what was right, what was missed, what was made up."""

from dataclasses import dataclass
from typing import Any

# Their place is not one joint, or depends on how the cause is told: any joint is right.
ANYWHERE = {"payload", "gravity_direction"}


@dataclass(frozen=True)
class Cause:
    """One accepted cause of gap.json and the set that it cannot be told from, itself included."""

    effect: str
    kind: str
    joint: str | None
    alike: tuple[tuple[str, str | None], ...]
    before: float | None
    after: float | None


@dataclass(frozen=True)
class Verdict:
    """What scoring needs of gap.json."""

    verdict: str
    causes: tuple[Cause, ...]
    not_testable: frozenset[str]

    @classmethod
    def read(cls, document: dict[str, Any]) -> "Verdict":
        """From gap.json.

        Raises
        ------
        ValueError
            Another format.
        """
        if document.get("format") != "idim_iv_ros/gap/1":
            raise ValueError(f"format {document.get('format')!r} is not idim_iv_ros/gap/1")
        return cls(
            verdict=document["verdict"],
            causes=tuple(_cause(item) for item in document["causes"]),
            not_testable=frozenset(item["effect"] for item in document.get("not_testable") or []),
        )


def _cause(item: dict[str, Any]) -> Cause:
    first_name = (item["effect"], item.get("joint"))
    others = tuple((o["effect"], o.get("joint")) for o in item.get("indistinguishable_from") or [])
    gap = item.get("torque_gap") or {}
    return Cause(
        effect=item["effect"],
        kind=item["kind"],
        joint=item.get("joint"),
        alike=(first_name, *(other for other in others if other != first_name)),
        before=gap.get("before"),
        after=gap.get("after"),
    )


@dataclass(frozen=True)
class CellScore:
    """A cell after scoring.

    Attributes
    ----------
    label : dict
        Of the generator.
    seconds : float
        Of the diagnosis.
    false_alarms : tuple of str
        Accepted causes that are not there, "effect[joint]", nor is anything in their set.
    named : tuple of bool
        For each true effect: is it, or is its set, among the accepted causes?
    first : bool
        The first cause, or its set, is a true effect at its joint.
    effect_first : bool
        The same, whatever the joint.
    set_size : int
        Of the first cause; 0 without one.
    shrinkage : float or None
        Share of the squared torque gap that the first cause removed, over the share that the
        true effect removes; None without figures or a single structural effect in the refit
        residual. A cause that was not found counts as 0.
    admitted : bool
        Every true effect was found, or listed as not testable on these recordings.
    """

    label: dict[str, Any]
    seconds: float
    verdict: str
    false_alarms: tuple[str, ...]
    named: tuple[bool, ...]
    first: bool
    effect_first: bool
    set_size: int
    shrinkage: float | None
    admitted: bool


@dataclass(frozen=True)
class Scored:
    """All judged cells, by name, and the cells that have no verdict with the reason."""

    cells: dict[str, CellScore]
    missing: dict[str, str]


def judge(label: dict[str, Any], verdict: Verdict, seconds: float) -> CellScore:
    """Compare a verdict with the truth.

    Where all parameters of the robot are off, parametric causes are true and not judged.
    """
    causes = [
        cause for cause in verdict.causes if not (label["altered"] and cause.kind == "parametric")
    ]
    truths = [truth for truth in label["effects"] if truth["kind"] != "outside"]
    named = tuple(any(names_truth(cause, truth) for cause in causes) for truth in truths)
    wrong = tuple(
        f"{cause.effect}[{cause.joint}]"
        for cause in causes
        if not any(names_truth(cause, truth) for truth in truths)
    )
    lead = causes[0] if causes else None
    return CellScore(
        label=label,
        seconds=seconds,
        verdict=verdict.verdict,
        false_alarms=wrong,
        named=named,
        first=lead is not None and any(names_truth(lead, truth) for truth in truths),
        effect_first=lead is not None
        and any(truth["effect"] in {e for e, _ in lead.alike} for truth in truths),
        set_size=len(lead.alike) if lead else 0,
        shrinkage=_shrinkage(label, truths, lead),
        admitted=all(
            seen or truth["effect"] in verdict.not_testable
            for seen, truth in zip(named, truths, strict=True)
        ),
    )


def names_truth(cause: Cause, truth: dict[str, Any]) -> bool:
    """Is the truth in the set of this cause?"""
    joints = {truth["joint"], *truth["joints"]} if truth["joints"] else {truth["joint"]}
    return any(
        effect == truth["effect"] and (effect in ANYWHERE or joint in joints)
        for effect, joint in cause.alike
    )


def _shrinkage(
    label: dict[str, Any], truths: list[dict[str, Any]], lead: Cause | None
) -> float | None:
    if len(truths) != 1 or truths[0]["measure"] != "refit" or truths[0]["kind"] != "structural":
        return None
    truth = truths[0]
    place = truth["joints"][0] if truth["joints"] else truth["joint"]
    with_effect = label["residual_rms"]["with"][place]
    without = label["residual_rms"]["without"][place]
    possible = 1.0 - (without / with_effect) ** 2
    if possible <= 0.0:
        return None
    if lead is None or not names_truth(lead, truth):
        return 0.0
    if not lead.before or lead.after is None:
        return None
    return (1.0 - (lead.after / lead.before) ** 2) / possible
