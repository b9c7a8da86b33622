"""What changed between two sets of recordings: the answer, what changed, joint by joint."""

from dataclasses import dataclass
from typing import Any

from idim_iv_ros.diagnosis.result import ContrastCause, ContrastResult, EffectParameter, GapResult
from idim_iv_ros.effects.registry import parameter_words
from idim_iv_ros.report.gap_words import effect_at, torque_unit
from idim_iv_ros.report.numerals import number, percent, sentence, with_unit
from idim_iv_ros.report.section import Report, Section

_CHANGES = {
    "appeared": "in the second set only",
    "vanished": "in the reference only",
    "changed": "second set less reference",
}


@dataclass(frozen=True)
class ChangeCard:
    """One thing that changed: its name, its numbers in words, and what they are numbers of."""

    name: str
    sentence: str
    numbers: dict[str, EffectParameter]
    of: str
    facts: tuple[tuple[str, str], ...]


def change_card(result: GapResult, cause: ContrastCause) -> ChangeCard:
    """Return a change as it is shown."""
    facts = [
        (
            f"Torque at {torque.joint}, rms",
            f"{with_unit(torque.rms, torque_unit(result, torque.joint))} "
            f"({percent(100.0 * torque.share_of_torque)} of its torque)",
        )
        for torque in cause.torques
    ]
    if cause.evidence.chosen_in_folds:
        facts.append(("Chosen again without a part of the time", cause.evidence.chosen_in_folds))
    others = ", ".join(
        effect_at(rival.effect, rival.joint) for rival in cause.indistinguishable_from
    )
    facts.append(("Indistinguishable from", others or "–"))
    return ChangeCard(
        effect_at(cause.effect, cause.joint, cause.other_joint),
        sentence(cause.sentence),
        {
            parameter_words(cause.effect, name): parameter
            for name, parameter in cause.parameters.items()
        },
        _CHANGES[cause.change],
        tuple(facts),
    )


def contrast_badge(contrast: ContrastResult) -> tuple[str, str, str]:
    """Return class, sign and words of the answer."""
    if not contrast.differs:
        return "good", "✓", "no difference"
    if contrast.causes:
        return "fair", "≠", "the sets differ"
    return "open", "?", "the sets differ, and nothing in the catalogue explains it"


def _contrast(report: Report[GapResult]) -> dict[str, Any] | None:
    result = report.result
    contrast = result.contrast
    if contrast is None:
        return None
    return {
        "badge": contrast_badge(contrast),
        "answer": contrast.sentence,
        "reference": ", ".join(contrast.reference),
        "against": ", ".join(contrast.against),
        "cards": [change_card(result, cause) for cause in contrast.causes],
        "joints": [
            (
                joint.joint,
                *(
                    f"{number(value)} {torque_unit(result, joint.joint)}"
                    for value in (joint.before, joint.after, joint.own)
                ),
                percent(100.0 * joint.share_of_torque),
                with_unit(joint.unexplained, torque_unit(result, joint.joint)),
            )
            for joint in contrast.joints
        ],
        "common": contrast.common,
        "notes": contrast.notes,
    }


CONTRAST = Section("What changed", "contrast", "contrast.html.j2", _contrast)
