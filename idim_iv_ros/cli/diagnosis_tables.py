"""The tables of a diagnosis on the terminal."""

from collections.abc import Sequence

from rich.console import Console
from rich.markup import escape

from idim_iv_ros.cli.table import print_table
from idim_iv_ros.diagnosis.parameter_words import surest
from idim_iv_ros.diagnosis.result import (
    Cause,
    ContrastResult,
    EffectParameter,
    Gap,
    GapResult,
    Indistinguishable,
)
from idim_iv_ros.report.gap_words import (
    VERDICTS,
    effect_at,
    effect_words,
    small_unit,
    stage_words,
    torque_unit,
    untestable,
)
from idim_iv_ros.report.numerals import measured
from idim_iv_ros.report.sections.contrast import contrast_badge

_STYLES = {"good": "green", "fair": "blue", "bad": "red", "open": "yellow"}
_MOST_UNTESTABLE = 10
_FEW_STAGES = 3  # the nominal model, the refit, and all that was found
_MOST_ROWS = 24
_MOST_NUMBERS = 4  # of one cause


def print_diagnosis(console: Console, result: GapResult, *, whole: bool = True) -> None:
    """Verdict, causes, stages, and what could not be tested; long tables `whole` or their start."""
    if result.contrast is not None:
        _print_contrast(console, result, result.contrast)
    tone, _, words = VERDICTS[result.verdict]
    words = words if result.contrast is None else f"{words} (the reference by itself)"
    console.print(f"[bold {_STYLES[tone]}]Verdict: {words}.[/]", highlight=False)
    console.print(escape(result.own_summary), highlight=False)
    for finding in result.findings:
        console.print(f"  {escape(finding)}", highlight=False)
    if result.causes:
        _print_causes(console, result)
    if result.hints:
        _print_hints(console, result)
    if result.stages:
        _print_stages(console, result, whole)
    if result.not_testable:
        _print_untestable(console, result, whole)
    for note in result.notes:
        console.print(f"Note: {escape(note)}", highlight=False)


def _print_contrast(console: Console, result: GapResult, contrast: ContrastResult) -> None:
    """The answer, what changed with its numbers, and what is left joint by joint."""
    tone, _, words = contrast_badge(contrast)
    console.print(f"[bold {_STYLES[tone]}]Contrast: {words}.[/]", highlight=False)
    console.print(escape(contrast.sentence), highlight=False)
    if contrast.causes:
        columns = [
            "what changed",
            "second set less reference (± 95 %)",
            "torque that it makes",
            "indistinguishable from",
        ]
        rows = [
            (
                f"{effect_words(each.effect)}\n{each.joint or 'all joints'}\n{each.change}",
                "\n".join(_shown(each.parameters)),
                "\n".join(
                    f"{one.joint}: {one.rms:.3g} {torque_unit(result, one.joint)} "
                    f"({100.0 * one.share_of_torque:.3g} %)"
                    for one in each.torques
                ),
                _names(each.indistinguishable_from, each.joint),
            )
            for each in contrast.causes
        ]
        print_table(console, "What changed, largest torque first", columns, rows)
    columns = [
        "joint",
        ">model of the reference",
        ">with what changed",
        ">with its own model",
        ">not explained",
    ]
    joints = [
        (
            each.joint,
            *(
                f"{value:.3g} {torque_unit(result, each.joint)}"
                for value in (each.before, each.after, each.own, each.unexplained)
            ),
        )
        for each in contrast.joints
    ]
    print_table(console, "Torque left in the second set, rms", columns, joints)
    for note in contrast.notes:
        console.print(f"Note: {escape(note)}", highlight=False)


def _print_causes(console: Console, result: GapResult) -> None:
    columns = [
        "effect, joint",
        "parameters (± 95 %)",
        "torque gap, shrinkage",
        "probable",
        "indistinguishable from",
    ]
    rows = []
    for cause in result.causes:
        joints = [each for each in (cause.joint, cause.other_joint) if each]
        rows.append(
            (
                f"{effect_words(cause.effect)}\n{', '.join(joints) or 'all joints'}",
                "\n".join(_shown(cause.parameters)),
                "\n".join(_gaps(result, cause)),
                "–" if cause.probability is None else f"{100.0 * cause.probability:.0f} %",
                _names(cause.indistinguishable_from, cause.joint),
            )
        )
    print_table(console, "Causes, strongest first", columns, rows)


def _print_hints(console: Console, result: GapResult) -> None:
    """What may be there, and is not sure enough for a cause."""
    columns = ["would be", "chosen in folds", "why it is only a hint"]
    rows = [
        (
            effect_at(each.effect, each.joint, each.other_joint),
            each.chosen_in_folds or "–",
            each.reason,
        )
        for each in result.hints
    ]
    print_table(console, "Hints, no causes", columns, rows)


def _shown(parameters: dict[str, EffectParameter]) -> list[str]:
    """The best determined numbers under their names in gap.json, and how many more there are."""
    shown = surest(parameters, _MOST_NUMBERS)
    lines = [_parameter(name, each) for name, each in shown.items()]
    more = len(parameters) - len(shown)
    return [*lines, f"and {more} more"] if more else lines


def _parameter(name: str, parameter: EffectParameter) -> str:
    value, half = measured(parameter.value, parameter.std)
    number = " ".join(filter(None, (value, half, parameter.unit)))
    return f"{name.replace('_', ' ')} = {number}"


def _gaps(result: GapResult, cause: Cause) -> list[str]:
    """Gap before and after at its own joint, and at the others that it changes."""
    gap = cause.torque_gap
    unit = torque_unit(result, cause.joint)
    lines = [f"{gap.before:.3g} → {gap.after:.3g} {unit}", _shrinkage(gap)]
    for each in cause.joint_gaps:
        share = f"{100.0 * each.share_of_torque:.3g} % of its torque"
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


def _names(others: Sequence[Indistinguishable], joint: str | None) -> str:
    names = [
        f"{effect_words(each.effect)} at {each.joint}"
        if each.joint and each.joint != joint
        else effect_words(each.effect)
        for each in others
    ]
    return "\n".join(names) or "–"


def _print_stages(console: Console, result: GapResult, whole: bool) -> None:
    """One row a joint: the nominal model, the refit, the extended model, the noise floor.

    The `whole` table has every stage, one row a joint and stage.
    """
    stages = list(result.stages)
    if not whole and len(stages) > _FEW_STAGES and len(stages) * len(result.joints) > _MOST_ROWS:
        stages = [*stages[: _FEW_STAGES - 1], stages[-1]]
    tracked = any(stage.tracking_rms for stage in stages)
    columns = ["joint", "model", ">torque"]
    if tracked:
        columns.append(">simulation")
    floors = {each.joint: each.noise_floor for each in result.joint_gaps}
    rows = []
    for joint in result.joints:
        unit, small = torque_unit(result, joint), small_unit(result, joint)
        for number, stage in enumerate(stages):
            row = ["" if number else joint, stage_words(stage.name)]
            row.append(_with_unit(stage.torque_rms.get(joint), unit))
            if tracked:
                error = (stage.tracking_rms or {}).get(joint)
                row.append(_with_unit(None if error is None else 1e3 * error, small))
            rows.append(row)
        floor = ["", _floor_words(result), _with_unit(floors.get(joint), unit)]
        rows.append(floor + [""] * tracked)
    print_table(console, "Gap of each model, rms, held out", columns, rows)
    if len(stages) < len(result.stages):
        left_out = len(result.stages) - len(stages)
        console.print(f"… and {left_out} models in between: --verbose prints them")


def _floor_words(result: GapResult) -> str:
    origins = {each.floor_origin for each in result.joint_gaps}
    return f"noise floor ({origins.pop()})" if len(origins) == 1 else "noise floor"


def _print_untestable(console: Console, result: GapResult, whole: bool) -> None:
    groups = untestable(result)
    columns = ["effect", "joint", "why", "record this next"]
    rows = [
        (effect_words(each.effect), each.joints or "all", each.reason, each.excitation_needed)
        for each in groups
    ]
    shown = rows if whole else rows[:_MOST_UNTESTABLE]
    print_table(console, "Not testable on this recording", columns, shown)
    if len(shown) < len(rows):
        console.print(f"… and {len(rows) - len(shown)} more: --verbose prints them")


def _with_unit(value: float | None, unit: str) -> str:
    return "–" if value is None else f"{value:.3g} {unit}"
