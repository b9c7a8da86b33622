"""The first screen: what was found, what to do next, the robot, and the numbers behind it."""

from collections.abc import Mapping, Sequence
from typing import Any

from idim_iv_ros.diagnosis.result import GapResult
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.report.advice import (
    diagnosis_headline,
    diagnosis_steps,
    identification_headline,
    identification_steps,
    verdict_badge,
)
from idim_iv_ros.report.gap_words import VERDICTS, duration, lacking_row, wrong_numbers
from idim_iv_ros.report.numerals import count, exact, number, percent, plural, with_unit
from idim_iv_ros.report.robot_drawing import robot_drawing
from idim_iv_ros.report.section import R, Report, Section

_DRAWING = (330.0, 330.0)  # pixels

# Name, value, note.
Tile = tuple[str, str, str]


def shaded_robot(report: Report[R]) -> dict[str, Any] | None:
    """Return the drawing of the robot, its joints coloured; None where it cannot be drawn."""
    skeleton = report.nominal.skeleton
    if skeleton is None:
        return None
    result = report.result
    values: Mapping[str, float | None]
    if isinstance(result, GapResult):
        values = {joint_gap.joint: 100.0 * joint_gap.share for joint_gap in result.joint_gaps}
        title = "share of the gap"
    else:
        values = result.fit.joint_relative_error_percent
        title = "relative error of the torque"
    shares = [values.get(joint) for joint in result.joints]
    return robot_drawing(skeleton, result.joints, shares, title, *_DRAWING)


def _frame(report: Report[R], **context: Any) -> dict[str, Any]:
    return {"robot": shaded_robot(report), "missing": report.nominal.missing, **context}


def _identification(report: Report[IdentificationResult]) -> dict[str, Any]:
    result = report.result
    return _frame(
        report,
        badge=verdict_badge(result.verdict.verdict),
        headline=identification_headline(result),
        steps=identification_steps(report),
        tiles=_identification_tiles(result),
        badge_of=verdict_badge,
    )


def _identification_tiles(result: IdentificationResult) -> Sequence[Tile]:
    fit = result.fit
    ls_error = f"IDIM-LS: {percent(fit.ls_relative_error_percent, 3)}"
    if result.estimator == "idim-ls":
        ls_error = "of the measured torque"
    seconds = sum(bag.duration for bag in result.bags)
    rates = " and ".join(exact(rate, "Hz") for rate in sorted({bag.rate for bag in result.bags}))
    row_rate = exact(round(result.processing.row_rate, 2), "Hz")
    essential = f"{fit.essential_parameters} of {fit.base_parameters}"
    return [
        ("Relative error", percent(fit.relative_error_percent, 3), ls_error),
        ("Parameters", essential, "sums that the torque shows, needed to explain it"),
        _iterations(result),
        ("Recorded", with_unit(seconds, "s"), f"{plural(len(result.bags), 'recording')}, {rates}"),
        ("Used", count(fit.samples), f"samples of all joints, decimated to {row_rate}"),
        ("Condition number", number(fit.condition_number), "of the observation matrix"),
    ]


def _iterations(result: IdentificationResult) -> Tile:
    if result.estimator == "idim-ls":
        return ("Estimator", "IDIM-LS", result.convergence_note)
    state = "converged" if result.converged else "NOT converged"
    if not result.converged:
        state += ": " + result.convergence_note.removeprefix("not converged: ")
    return ("Iterations", str(result.iterations), state)


def _diagnosis(report: Report[GapResult]) -> dict[str, Any]:
    result = report.result
    first = result.stages[0] if result.stages else None
    nominal = first is not None and first.name == "given"
    return _frame(
        report,
        badge=VERDICTS[result.verdict],
        headline=diagnosis_headline(result),
        steps=diagnosis_steps(report),
        lacking=[
            lacking_row(result, cause) for cause in result.causes if cause.kind == "structural"
        ],
        wrong=wrong_numbers(result),
        tiles=_diagnosis_tiles(result),
        model="nominal model" if nominal else "refit",
    )


def _diagnosis_tiles(result: GapResult) -> Sequence[Tile]:
    bags = plural(len(result.bags), "recording")
    untestable = "effects that this recording cannot show"
    return [
        ("Recorded", with_unit(duration(result), "s"), bags),
        ("Hints", str(len(result.hints)), "that are not sure enough for a cause"),
        ("Not testable", str(len(result.not_testable)), untestable),
    ]


VERDICT = Section("Verdict", "verdict", "verdict.html.j2", _identification)
GAP_VERDICT = Section("Verdict", "verdict", "gap_verdict.html.j2", _diagnosis)
