"""The tables of a diagnosis on the terminal."""

from collections.abc import Sequence

from rich.console import Console
from rich.text import Text

from idim_iv_ros.cli.output import print_table
from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.diagnosis.result.recordings import ContrastResult
from idim_iv_ros.effects.cause import EffectParameter, surest
from idim_iv_ros.errors import first_of
from idim_iv_ros.report import gap_words
from idim_iv_ros.report.advice import contrast_headline, diagnosis_headline, difference_rows
from idim_iv_ros.report.numerals import MISSING, number, plural, with_interval, with_unit

_STYLES = {"good": "green", "fair": "blue", "bad": "red", "open": "yellow"}
# Columns of the tables.
_LACKING = ("effect", ">torque gap there, rms", ">removed (95 %)", ">probable", "or else")
_DIFFERING = ("recording", "by", "size")
_NUMBERS = ("cause", "by (± 95 %)", ">probable", "or else")
_CHANGES = (
    *("what changed", "second set less reference (± 95 %)", "torque that it makes"),
    "indistinguishable from",
)
_MOST_NUMBERS = 2  # of a cause
_MOST_NAMES = 4  # of hints


def print_diagnosis(console: Console, result: GapResult) -> None:
    """Print the first screen of the report: one line for each cause and each joint."""
    if result.contrast is not None:
        _print_contrast(console, result, result.contrast)
    tone, _, words = gap_words.verdict_of(result)
    words = words if result.contrast is None else f"{words} (the reference by itself)"
    console.print(Text(f"Verdict: {words}.", style=f"bold {_STYLES[tone]}"))
    console.print(Text(" ".join(diagnosis_headline(result))))
    differing = difference_rows(result)
    if differing:
        print_table(console, "Recordings that differ from the others", _DIFFERING, differing)
    rows = [(gap_words.lacking_row(result, cause), cause) for cause in result.causes]
    lacking = [row for row, cause in rows if cause.kind == "structural"]
    if lacking:
        print_table(console, "What the simulator cannot do", _LACKING, lacking)
    numbers = [
        (row[0], _parameters(cause.parameters), row[3], row[4])
        for row, cause in rows
        if cause.kind == "parametric"
    ]
    if numbers:
        print_table(console, "Numbers of the model that are wrong", _NUMBERS, numbers)
    if result.stages and result.contrast is None:
        _print_gaps(console, result)
    names = [gap_words.hint_words(hint) for hint in result.hints]
    if names:
        console.print(Text(f"Hints, no causes: {first_of(names, _MOST_NAMES)}"))
    lengths = (len(result.findings), len(gap_words.untestable(result)), len(result.notes))
    kinds = ("finding", "untestable effect", "note")
    counts = [plural(count, kind) for count, kind in zip(lengths, kinds, strict=True) if count]
    console.print(Text(f"The report has {', '.join(['all numbers', *counts])}"))


def _print_contrast(console: Console, result: GapResult, contrast: ContrastResult) -> None:
    tone, _, words = gap_words.contrast_badge(contrast)
    console.print(Text(f"Contrast: {words}.", style=f"bold {_STYLES[tone]}"))
    console.print(Text(" ".join(contrast_headline(contrast))))
    rows = []
    for cause in contrast.causes:
        effect = gap_words.effect_words(cause.effect)
        what = f"{effect}\n{cause.joint or 'all joints'}\n{cause.change}"
        torques = [
            f"{torque.joint}: {torque.rms:.3g} {gap_words.torque_unit(result, torque.joint)} "
            f"({100.0 * torque.share_of_torque:.3g} %)"
            for torque in cause.torques[:2]
        ]
        others = [
            gap_words.effect_at(other.effect, None if other.joint == cause.joint else other.joint)
            for other in cause.indistinguishable_from
        ]
        numbers, alike = _parameters(cause.parameters), "\n".join(others) or MISSING
        rows.append((what, numbers, "\n".join(torques), alike))
    if rows:
        print_table(console, "What changed, largest torque first", _CHANGES, rows)


def _parameters(parameters: dict[str, EffectParameter]) -> str:
    """Return the best determined numbers with their names in gap.json, and how many are left."""
    lines = [
        f"{name.replace('_', ' ')} = {with_interval(by.value, by.std, by.unit)}"
        for name, by in surest(parameters, _MOST_NUMBERS).items()
    ]
    remaining = len(parameters) - len(lines)
    return "\n".join([*lines, f"and {remaining} more"] if remaining else lines)


def _print_gaps(console: Console, result: GapResult) -> None:
    first, last = result.stages[0], result.stages[-1]
    floors = {gap.joint: gap.noise_floor for gap in result.where.joints}
    rows = []
    for joint in result.joints:
        if joint in result.left_out:
            rows.append((joint, "left out", MISSING, MISSING))
            continue
        unit, small = gap_words.torque_unit(result, joint), gap_words.small_unit(result, joint)
        torques = [stage.torque_rms.get(joint) for stage in (first, last)]
        motions = [(stage.tracking_rms or {}).get(joint) for stage in (first, last)]
        noise = with_unit(floors.get(joint), unit)
        rows.append((joint, _arrow(torques, unit), noise, _arrow(motions, small, 1e3)))
    # All parameters are fitted again beside the causes.
    after = "refit with causes" if len(result.stages) > 2 else gap_words.stage_words(last.name)
    title = f"Gap, rms: {gap_words.stage_words(first.name)} → {after}"
    print_table(console, title, ("joint", ">torque", ">noise", ">simulated motion"), rows)


def _arrow(pair: Sequence[float | None], unit: str, factor: float = 1.0) -> str:
    """Return two numbers with their unit as text: “before → after”."""
    numbers = [number(None if value is None else factor * value) for value in pair]
    return MISSING if pair[0] is None and pair[1] is None else f"{' → '.join(numbers)} {unit}"
