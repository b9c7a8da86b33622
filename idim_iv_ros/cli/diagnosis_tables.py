"""The tables of a diagnosis on the terminal."""

from collections.abc import Sequence

from rich.console import Console
from rich.text import Text

from idim_iv_ros.cli.output import print_marked, print_table
from idim_iv_ros.diagnosis.result import ContrastResult, EffectParameter, GapResult
from idim_iv_ros.effects.cause import surest
from idim_iv_ros.report.advice import contrast_headline, diagnosis_headline
from idim_iv_ros.report.gap_words import (
    VERDICTS,
    effect_at,
    effect_words,
    lacking_row,
    small_unit,
    stage_words,
    torque_unit,
    untestable,
)
from idim_iv_ros.report.numerals import measured
from idim_iv_ros.report.sections.causes import contrast_badge, contrast_rows, hint_row

_STYLES = {"good": "green", "fair": "blue", "bad": "red", "open": "yellow"}
# Columns of the tables.
_LACKING = ("effect", ">torque gap there, rms", ">removed (95 %)", ">probable", "or else")
_NUMBERS = ("cause", "by (± 95 %)", ">probable", "or else")
_CHANGES = (
    *("what changed", "second set less reference (± 95 %)", "torque that it makes"),
    "indistinguishable from",
)
_HINTS = ("would be", "with", "chosen in folds", "why it is only a hint")
_LEFT = (
    *("joint", ">model of the reference", ">with what changed", ">with its own model"),
    *(">difference", ">not explained"),
)
_STAGES = ("joint", "model", ">torque", ">simulation")
_UNTESTABLE = ("effect", "joint", "why", "seen from", "record this next")

_MOST_NAMES = 4  # of hints, without --verbose


def print_diagnosis(console: Console, result: GapResult, *, whole: bool = True) -> None:
    """Print verdict, causes, stages and what could not be tested.

    Not `whole`: what the first screen of the report says, one line a cause and a joint.
    """
    if result.contrast is not None:
        _print_contrast(console, result, result.contrast, whole)
    tone, _, words = VERDICTS[result.verdict]
    words = words if result.contrast is None else f"{words} (the reference by itself)"
    console.print(Text(f"Verdict: {words}.", style=f"bold {_STYLES[tone]}"))
    console.print(Text(result.own_summary if whole else " ".join(diagnosis_headline(result))))
    for finding in result.findings if whole else ():
        console.print(Text(f"  {finding}"))
    _print_causes(console, result, whole)
    if result.stages and whole:
        _print_stages(console, result)
    elif result.stages and result.contrast is None:
        _print_gaps(console, result)
    if not whole:
        _print_what_is_left(console, result)
        return
    if result.hints:
        rows = [hint_row(result, hint) for hint in result.hints]
        print_table(console, "Hints, no causes", _HINTS, rows)
    if result.not_testable:
        print_table(console, "Not testable on this recording", _UNTESTABLE, untestable(result))
    print_marked(console, "Note", result.notes)


def _print_causes(console: Console, result: GapResult, whole: bool) -> None:
    """Print what the simulator cannot do, and the numbers of parametric causes, or of all."""
    rows = [(lacking_row(result, cause), cause) for cause in result.causes]
    lacking = [row for row, cause in rows if cause.kind == "structural"]
    if lacking:
        print_table(console, "What the simulator cannot do", _LACKING, lacking)
    numbers = [
        (row[0], _parameters(cause.parameters, 4 if whole else 2), row[3], row[4])
        for row, cause in rows
        if whole or cause.kind == "parametric"
    ]
    if numbers:
        title = "Causes, strongest first" if whole else "Numbers of the model that are wrong"
        print_table(console, title, _NUMBERS, numbers)
    for row, cause in rows if whole else ():
        gaps = [f"{gap.joint} {_arrow((gap.before, gap.after), torque_unit(result, gap.joint))}"
                for gap in cause.joint_gaps]  # fmt: skip
        if len(gaps) > 1:
            console.print(Text(f"{row[0]} takes of the torque gap, rms: {', '.join(gaps)}"))


def _print_what_is_left(console: Console, result: GapResult) -> None:
    """Name the first hints, and count what --verbose prints."""
    names = [effect_at(hint.effect, hint.joint, hint.other_joint) for hint in result.hints]
    if names:
        more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
        console.print(Text(f"Hints, no causes: {', '.join(names[:_MOST_NAMES])}{more}"))
    folded = {
        "findings": result.findings,
        "untestable effects": untestable(result),
        "notes": result.notes,
    }
    left = [
        f"{len(items)} {words if len(items) > 1 else words[:-1]}"
        for words, items in folded.items()
        if items
    ]
    console.print(Text(f"--verbose adds {', '.join(['all numbers', *left])}"))


def _print_contrast(
    console: Console, result: GapResult, contrast: ContrastResult, whole: bool
) -> None:
    """Print the answer, what changed with its numbers, and the torque left at each joint."""
    tone, _, words = contrast_badge(contrast)
    console.print(Text(f"Contrast: {words}.", style=f"bold {_STYLES[tone]}"))
    console.print(
        Text(contrast.sentence if whole else " ".join(contrast_headline(result, contrast)))
    )
    rows = [
        (
            f"{effect_words(cause.effect)}\n{cause.joint or 'all joints'}\n{cause.change}",
            _parameters(cause.parameters, 4 if whole else 2),
            "\n".join(
                f"{torque.joint}: {torque.rms:.3g} {torque_unit(result, torque.joint)} "
                f"({100.0 * torque.share_of_torque:.3g} %)"
                for torque in cause.torques[: None if whole else 2]
            ),
            "\n".join(
                effect_at(other.effect, None if other.joint == cause.joint else other.joint)
                for other in cause.indistinguishable_from
            )
            or "–",
        )
        for cause in contrast.causes
    ]
    if rows:
        print_table(console, "What changed, largest torque first", _CHANGES, rows)
    if whole:
        left = contrast_rows(result, contrast)
        print_table(console, "Torque left in the second set, rms", _LEFT, left)
        print_marked(console, "Note", contrast.notes)


def _parameters(parameters: dict[str, EffectParameter], most: int = 4) -> str:
    """Return the best determined numbers under their names in gap.json, and how many are left."""
    lines = []
    for name, parameter in surest(parameters, most).items():
        number = filter(None, (*measured(parameter.value, parameter.std), parameter.unit))
        lines.append(f"{name.replace('_', ' ')} = {' '.join(number)}")
    left = len(parameters) - len(lines)
    return "\n".join([*lines, f"and {left} more"] if left else lines)


def _print_gaps(console: Console, result: GapResult) -> None:
    """Print one line a joint: the gap of the first model and of the last one, and the noise."""
    first, last = result.stages[0], result.stages[-1]
    floors = {gap.joint: gap.noise_floor for gap in result.joint_gaps}
    rows = []
    for joint in result.joints:
        unit, small = torque_unit(result, joint), small_unit(result, joint)
        torques = [stage.torque_rms.get(joint) for stage in (first, last)]
        motions = [(stage.tracking_rms or {}).get(joint) for stage in (first, last)]
        noise = _with_unit(floors.get(joint), unit)
        rows.append((joint, _arrow(torques, unit), noise, _arrow(motions, small, 1e3)))
    after = "causes" if len(result.stages) > 2 else stage_words(last.name)
    title = f"Gap, rms: {stage_words(first.name)} → {after}"
    print_table(console, title, ("joint", ">torque", ">noise", ">simulated motion"), rows)


def _arrow(pair: Sequence[float | None], unit: str, factor: float = 1.0) -> str:
    numbers = ["–" if value is None else f"{factor * value:.3g}" for value in pair]
    return "–" if pair[0] is None and pair[1] is None else f"{' → '.join(numbers)} {unit}"


def _print_stages(console: Console, result: GapResult) -> None:
    """Print the gap of every model between the nominal and the extended one, joint by joint."""
    floors = {gap.joint: gap.noise_floor for gap in result.joint_gaps}
    origins = {gap.floor_origin for gap in result.joint_gaps}
    floor_words = f"noise floor ({origins.pop()})" if len(origins) == 1 else "noise floor"
    rows = []
    for joint in result.joints:
        unit, small = torque_unit(result, joint), small_unit(result, joint)
        for stage in result.stages:
            error = (stage.tracking_rms or {}).get(joint)
            torque, tracking = stage.torque_rms.get(joint), _with_unit(error, small, 1e3)
            name = joint if stage is result.stages[0] else ""
            rows.append((name, stage_words(stage.name), _with_unit(torque, unit), tracking))
        rows.append(("", floor_words, _with_unit(floors.get(joint), unit), ""))
    print_table(console, "Gap of each model, rms, held out", _STAGES, rows)


def _with_unit(value: float | None, unit: str, factor: float = 1.0) -> str:
    return "–" if value is None else f"{factor * value:.3g} {unit}"
