"""The tables of a diagnosis on the terminal."""

from rich.console import Console
from rich.table import Table

from idim_iv_ros.gap.parameter_words import surest
from idim_iv_ros.gap.result import Cause, EffectParameter, Gap, GapResult
from idim_iv_ros.report.gap_words import (
    VERDICTS,
    effect_words,
    small_unit,
    stage_words,
    torque_unit,
    untestable,
)
from idim_iv_ros.report.numerals import measured

_COLOURS = {"good": "green", "fair": "blue", "bad": "red", "open": "yellow"}
_MOST_UNTESTABLE = 10
_MOST_NUMBERS = 4  # of one cause


def print_diagnosis(console: Console, result: GapResult) -> None:
    """Verdict, causes, stages, and what could not be tested."""
    colour, _, words = VERDICTS[result.verdict]
    console.print(f"[bold {_COLOURS[colour]}]Verdict: {words}.[/]", highlight=False)
    console.print(_plain(result.summary), highlight=False)
    for finding in result.findings:
        console.print(f"  {_plain(finding)}", highlight=False)
    if result.causes:
        console.print(_causes(result))
    if result.stages:
        console.print(_stages(result))
    if result.not_testable:
        _print_untestable(console, result)
    for note in result.notes:
        console.print(f"Note: {_plain(note)}", highlight=False)


def _causes(result: GapResult) -> Table:
    table = Table(title="Causes, strongest first", title_justify="left")
    table.add_column("effect, joint")
    table.add_column("parameters (± 95 %)")
    table.add_column("torque gap, shrinkage", no_wrap=True)
    table.add_column("cannot be told from")
    for cause in result.causes:
        joints = [each for each in (cause.joint, cause.other_joint) if each]
        table.add_row(
            _plain(f"{effect_words(cause.effect)}\n{', '.join(joints) or 'all joints'}"),
            _plain("\n".join(_parameters(cause))),
            _plain("\n".join(_gaps(result, cause))),
            _plain(_rivals(cause)),
        )
    return table


def _parameters(cause: Cause) -> list[str]:
    """The surest of its numbers under their names in gap.json; words and all are in the report."""
    shown = surest(cause.parameters, _MOST_NUMBERS)
    lines = [_parameter(name, each) for name, each in shown.items()]
    more = len(cause.parameters) - len(shown)
    return [*lines, f"and {more} more"] if more else lines


def _parameter(name: str, parameter: EffectParameter) -> str:
    value, half = measured(parameter.value, parameter.std)
    return " ".join(filter(None, (f"{name.replace('_', ' ')} =", value, half, parameter.unit)))


def _gaps(result: GapResult, cause: Cause) -> list[str]:
    """Gap before and after at its own joint, and at the others that it changes."""
    gap = cause.torque_gap
    unit = torque_unit(result, cause.joint)
    lines = [f"{gap.before:.3g} → {gap.after:.3g} {unit}", _shrinkage(gap)]
    for each in cause.joint_gaps:
        share = f"{100.0 * each.share_of_torque:.2g} % of its torque"
        if each.joint != cause.joint:
            unit = torque_unit(result, each.joint)
            lines.append(f"{each.joint}: {each.before:.3g} → {each.after:.3g} {unit}")
        lines.append(share)
    return lines


def _shrinkage(gap: Gap) -> str:
    if gap.shrinkage is None:
        return "shrinkage unknown"
    interval = ""
    if gap.ci95 is not None:
        interval = f" ({100.0 * gap.ci95[0]:.0f} to {100.0 * gap.ci95[1]:.0f} %)"
    return f"{100.0 * gap.shrinkage:.0f} %{interval} less"


def _rivals(cause: Cause) -> str:
    rivals = [
        f"{effect_words(each.effect)} at {each.joint}"
        if each.joint and each.joint != cause.joint
        else effect_words(each.effect)
        for each in cause.indistinguishable_from
    ]
    return "\n".join(rivals) or "–"


def _stages(result: GapResult) -> Table:
    table = Table(title="Torque gap of each model, rms, held out", title_justify="left")
    table.add_column("model")
    for joint in result.joints:
        table.add_column(_plain(f"{joint}\n{torque_unit(result, joint)}"), justify="right")
    tracked = any(stage.tracking_rms for stage in result.stages)
    kinds: dict[str, list[str]] = {}  # joints by the unit of their motion
    for joint in result.joints if tracked else ():
        kinds.setdefault(small_unit(result, joint), []).append(joint)
    for small in kinds:
        table.add_column(f"simulation gap,\nlargest, {small}", justify="right")
    for stage in result.stages:
        cells = [_number(stage.torque_rms.get(joint)) for joint in result.joints]
        for joints in kinds.values():
            errors = [(stage.tracking_rms or {}).get(joint) for joint in joints]
            known = [1e3 * error for error in errors if error is not None]
            cells.append(_number(max(known, default=None)))
        table.add_row(_plain(stage_words(stage.name)), *cells)
    floors = {each.joint: each.noise_floor for each in result.joint_gaps}
    cells = [_number(floors.get(joint)) for joint in result.joints]
    table.add_row(_floor_words(result), *cells, *([""] * len(kinds)), style="dim")
    return table


def _floor_words(result: GapResult) -> str:
    origins = {each.floor_origin for each in result.joint_gaps}
    return f"noise floor ({origins.pop()})" if len(origins) == 1 else "noise floor"


def _print_untestable(console: Console, result: GapResult) -> None:
    groups = untestable(result)
    table = Table(title="Not testable on this recording", title_justify="left")
    table.add_column("effect")
    table.add_column("joint")
    table.add_column("why")
    table.add_column("record this next")
    for each in groups[:_MOST_UNTESTABLE]:
        cells = (effect_words(each.effect), each.joints or "all")
        table.add_row(*map(_plain, (*cells, each.reason, each.excitation_needed)))
    console.print(table)
    if len(groups) > _MOST_UNTESTABLE:
        console.print(f"… and {len(groups) - _MOST_UNTESTABLE} more in the report")


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}"


def _plain(text: str) -> str:
    """Text in which no square bracket is markup."""
    return text.replace("[", "\\[")
