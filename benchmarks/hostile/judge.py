"""One answer against one label: what was named, what was missed, what was made up."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from benchmarks.withheld_effects.verdict import Cause, Verdict, holds

NORMAL_975 = 1.959964
NEEDS_LAW = ("controller_mismatch",)


@dataclass(frozen=True)
class Answer:
    """A cell after scoring.

    Attributes
    ----------
    label : dict
        Of the generator.
    seconds : float
        Of one core.
    verdict : str
    said : tuple of str
        All causes in their order, ``effect[joint]``, the set behind a bar.
    false_names : tuple of str
        Causes whose whole set is wrong.
    found : tuple of bool
        For each true effect: is it, or is it in the set of, an accepted cause?
    first : bool
        The first cause that is judged is a true effect at its joint, or has one in its set.
    sets : tuple of int
        Sizes of the sets of the judged causes.
    covering : tuple of bool
        Whether each of these sets holds a true effect.
    mass_in_interval : bool or None
        Of a true payload; None without one, or where it was not named itself.
    unanswerable : tuple of str
        True effects that nothing in the files can show: not asked for, and not in `found`.
    """

    label: dict[str, Any]
    seconds: float
    verdict: str
    said: tuple[str, ...]
    false_names: tuple[str, ...]
    found: tuple[bool, ...]
    first: bool
    sets: tuple[int, ...]
    covering: tuple[bool, ...]
    mass_in_interval: bool | None
    unanswerable: tuple[str, ...] = ()

    @property
    def outcome(self) -> str:
        """``hit``, ``abstained`` or ``missed``, and false names; of one row of the page."""
        if self.false_names:
            return "false name" if not any(self.found) else "hit and false name"
        if not self.found:
            cannot = f" (no {' and '.join(self.unanswerable)} can)" if self.unanswerable else ""
            return f"right: nothing named{cannot}"
        if all(self.found):
            return "hit"
        return "part found" if any(self.found) else "abstained"


def judge(label: dict[str, Any], document: Mapping[str, Any], seconds: float) -> Answer:
    """Compare gap.json with the truth.

    Where the nominal model is off, what that makes true is not asked for and is no false name.
    Another control law is not asked for where the configuration says that the law is unknown.

    Raises
    ------
    ValueError
        Another format.
    """
    verdict = Verdict.read(dict(document))
    unanswerable = _unanswerable(label)
    truths = [
        truth
        for truth in label["effects"]
        if truth["kind"] != "outside" and truth["effect"] not in unanswerable
    ]
    asked = {truth["effect"] for truth in truths}
    also = set(label["also_true"]) - asked
    judged = [cause for cause in verdict.causes if _about(cause, truths) or not _also(cause, also)]
    covering = tuple(_about(cause, truths) for cause in judged)
    return Answer(
        label=label,
        seconds=seconds,
        verdict=verdict.verdict,
        said=tuple(map(_words, verdict.causes)),
        false_names=tuple(
            _words(cause) for cause, right in zip(judged, covering, strict=True) if not right
        ),
        found=tuple(any(holds(cause, truth) for cause in judged) for truth in truths),
        first=bool(covering) and covering[0],
        sets=tuple(len(cause.alike) for cause in judged),
        covering=covering,
        mass_in_interval=_mass(truths, document),
        unanswerable=unanswerable,
    )


def _unanswerable(label: Mapping[str, Any]) -> tuple[str, ...]:
    """Another law than the configured one, where none is configured: one can only abstain."""
    if label["nuisances"]["knows_controller"]:
        return ()
    effects = {truth["effect"] for truth in label["effects"]}
    return tuple(effect for effect in NEEDS_LAW if effect in effects)


def _about(cause: Cause, truths: list[dict[str, Any]]) -> bool:
    return any(holds(cause, truth) for truth in truths)


def _also(cause: Cause, also: set[str]) -> bool:
    """Whether a cause, or one in its set, is what the nuisances make true."""
    return any(effect in also for effect, _ in cause.alike)


def _words(cause: Cause) -> str:
    (effect, joint), *others = cause.alike
    own = f"{effect}[{joint}]" if joint else effect
    return own + "".join(f" | {name}[{place}]" if place else f" | {name}" for name, place in others)


def _mass(truths: list[dict[str, Any]], document: Mapping[str, Any]) -> bool | None:
    masses = [truth["mass"] for truth in truths if truth["effect"] == "payload"]
    if not masses:
        return None
    for item in document["causes"]:
        mass = item["parameters"].get("mass") if item["effect"] == "payload" else None
        if mass is not None and mass["std"] is not None:
            return bool(abs(mass["value"] - masses[0]) <= NORMAL_975 * mass["std"])
    return None
