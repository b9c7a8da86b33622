"""One answer against one label: what was named, what was missed, what was made up."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from benchmarks.withheld_effects.verdict import ANYWHERE, Cause, Verdict

NORMAL_975 = 1.959964
HIT_PLACES = 2  # the truth may stand so far down in the set of a cause
NOWHERE = 1_000_000
Name = tuple[str, str | None]


@dataclass(frozen=True)
class TruthRank:
    """One true effect in an answer.

    Attributes
    ----------
    hit : bool
        A cause whose first name is this effect, or whose set has it among the first two.
    anywhere : bool
        In some set, at any place.
    first : bool
        In this sense a hit, and by the first of the causes that count.
    """

    hit: bool
    anywhere: bool
    first: bool


@dataclass(frozen=True)
class Answer:
    """A cell after scoring.

    Attributes
    ----------
    label : dict
        Of the generator.
    seconds : float
        Of processor.
    peak : float
        MB of memory; NaN where it was not measured.
    verdict : str
    said : tuple of str
        All causes in their order, ``effect[joint]``, the set behind a bar.
    ranked : tuple of TruthRank
        Of each true effect of the catalogue.
    false_names : tuple of str
        Causes that count and whose whole set is wrong.
    sets : tuple of int
        Sizes of the sets of the causes that count.
    claims : tuple of (float or None, bool)
        Probability said, and truth of the first name, of each cause that counts.
    mass_in_interval : bool or None
        Of a true payload; None without one, or where it was not named itself.
    """

    label: dict[str, Any]
    seconds: float
    peak: float
    verdict: str
    said: tuple[str, ...]
    ranked: tuple[TruthRank, ...]
    false_names: tuple[str, ...]
    sets: tuple[int, ...]
    claims: tuple[tuple[float | None, bool], ...]
    mass_in_interval: bool | None

    @property
    def outcome(self) -> str:
        """``right``, ``part``, ``missed``, with `` + false`` where a cause is."""
        hits = [truth.hit for truth in self.ranked]
        said = "right" if all(hits) else "part" if any(hits) else "missed"
        return said + (" + false" if self.false_names else "")

    @property
    def right(self) -> bool:
        """Everything found, and nothing made up."""
        return self.outcome == "right"


def judge(
    label: dict[str, Any], document: Mapping[str, Any], seconds: float, peak: float = float("nan")
) -> Answer:
    """Compare gap.json with the truth.

    A name that is true for another reason than what is asked for (`also_true` of the label: what
    errors of the nominal model make true) counts for nothing, either way: a cause that begins
    with such a name is not judged unless it is a hit, and in the set of another cause the name is
    as if it were not there.

    Raises
    ------
    ValueError
        Another format.
    """
    verdict = Verdict.read(dict(document))
    truths = truths_of(label)
    also = [(other["effect"], other["joint"]) for other in label["also_true"]]
    counting = []
    for cause, item in zip(verdict.causes, document["causes"], strict=True):
        hit = any(rank(cause, truth) < HIT_PLACES for truth in truths)
        if hit or not is_also_true(cause.alike[0], also) or is_named(cause.alike[0], truths):
            counting.append((cause, item))
    counted = [
        [name for name in cause.alike if is_named(name, truths) or not is_also_true(name, also)]
        for cause, _ in counting
    ]
    return Answer(
        label=label,
        seconds=seconds,
        peak=peak,
        verdict=verdict.verdict,
        said=tuple(map(_words, verdict.causes)),
        ranked=tuple(
            TruthRank(
                hit=any(rank(cause, truth) < HIT_PLACES for cause in verdict.causes),
                anywhere=any(rank(cause, truth) < NOWHERE for cause in verdict.causes),
                first=bool(counting) and rank(counting[0][0], truth) < HIT_PLACES,
            )
            for truth in truths
        ),
        false_names=tuple(
            _words(cause)
            for (cause, _), names in zip(counting, counted, strict=True)
            if not any(is_named(name, truths) for name in names)
        ),
        sets=tuple(map(len, counted)),
        claims=tuple(
            (item.get("probability"), is_named(cause.alike[0], truths)) for cause, item in counting
        ),
        mass_in_interval=_mass(truths, document),
    )


def truths_of(label: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Effects that are asked for: of the catalogue, and present in the recording.

    Where an effect cannot be made to stand out at all its strength is zero: it is not there.
    """
    return [
        truth
        for truth in label["effects"]
        if truth["kind"] != "outside" and truth["strength"] != 0.0
    ]


def rank(cause: Cause, truth: Mapping[str, Any]) -> int:
    """Place of a true effect in the set of a cause, from 0; `NOWHERE` where it is not."""
    places = (k for k, name in enumerate(cause.alike) if is_named(name, [truth]))
    return next(places, NOWHERE)


def is_named(name: Name, truths: Iterable[Mapping[str, Any]]) -> bool:
    """Is a name one of these true effects, at its joint?

    Either joint of a coupling is right, and any of a payload and of the direction of gravity. What
    acts on all joints has no joint: that is its name.
    """
    effect, joint = name
    for truth in truths:
        joints = {truth["joint"]}
        if truth["joint"] is not None:
            joints |= {*truth["joints"]}
        if effect == truth["effect"] and (effect in ANYWHERE or joint in joints):
            return True
    return False


def is_also_true(name: Name, also: Iterable[Name]) -> bool:
    return any(name[0] == effect and joint in (None, name[1]) for effect, joint in also)


def _words(cause: Cause) -> str:
    return " | ".join(f"{effect}[{joint}]" if joint else effect for effect, joint in cause.alike)


def _mass(truths: list[dict[str, Any]], document: Mapping[str, Any]) -> bool | None:
    masses = [truth["mass"] for truth in truths if truth["effect"] == "payload"]
    if not masses:
        return None
    for item in document["causes"]:
        mass = item["parameters"].get("mass") if item["effect"] == "payload" else None
        if mass is not None and mass["std"] is not None:
            return bool(abs(mass["value"] - masses[0]) <= NORMAL_975 * mass["std"])
    return None
