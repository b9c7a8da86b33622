"""The first screen of a report: findings, next steps, drawing of the robot, key numbers."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.model.skeleton import Skeleton
from idim_iv_ros.report.advice import (
    diagnosis_headline,
    diagnosis_steps,
    difference_rows,
    identification_headline,
    identification_steps,
    verdict_badge,
)
from idim_iv_ros.report.gap_words import duration, lacking_row, verdict_of, wrong_numbers
from idim_iv_ros.report.numerals import count, exact, is_number, number, percent, plural, with_unit
from idim_iv_ros.report.section import R, Report, Section
from idim_iv_ros.types import FloatArray

# From small to large shares; distinct on white and on black, and by lightness.
_COLOURS = ((0.0, (154, 181, 204)), (0.45, (240, 170, 95)), (1.0, (190, 52, 20)))
# Half of the length that is drawn of a joint's axis: of the robot's size, and m where it has none.
_AXIS, _AXIS_ALONE = 0.07, 0.2
_SIZE = 330.0  # pixels of the robot's longer side
_COLUMN, _LINE, _LETTER = 30.0, 18.0, 8.0  # pixels: to the labels, height and letter of one
_AZIMUTH, _ELEVATION = np.radians(-55.0), np.radians(20.0)

# Name, value, note.
Tile = tuple[str, str, str]


def _shaded_robot(report: Report[R]) -> dict[str, Any] | None:
    """Return a drawing of the robot with coloured joints; None where it cannot be drawn."""
    skeleton = report.nominal.skeleton
    if skeleton is None:
        return None
    result = report.result
    values: Mapping[str, float | None]
    if isinstance(result, GapResult):
        values = {joint_gap.joint: 100.0 * joint_gap.share for joint_gap in result.where.joints}
        title = "share of the gap"
    else:
        values = result.fit.joint_relative_error_percent
        title = "relative error of the torque"
    shares = [values.get(joint) for joint in result.joints]
    return robot_drawing(skeleton, result.joints, shares, title)


def robot_drawing(
    skeleton: Skeleton,
    joints: Sequence[str],
    values: Sequence[float | None],
    title: str,
) -> dict[str, Any]:
    """Return the variables of the macro ``robot``; `values` (n_joints,), %, colour the joints.

    The robot has a corner at 0, 0; labels are in a column to the right of it. Lines are (x1, y1,
    x2, y2), pixels, y downwards.
    """
    points = np.array([point for line in skeleton.segments for point in line])
    size = float(np.ptp(points, axis=0).max())
    half = (_AXIS * size or _AXIS_ALONE) * skeleton.axes
    ends = zip(skeleton.origins - half, skeleton.origins + half, strict=True)
    segments, axes = (
        np.array([[_project(start), _project(end)] for start, end in lines])
        for lines in (skeleton.segments, ends)
    )
    corners = np.concatenate([segments, axes]).reshape(-1, 2)
    low, high = corners.min(axis=0), corners.max(axis=0)
    extent = np.maximum(high - low, 1e-9)
    scale = _SIZE / float(extent.max())
    width, height = np.round(scale * extent, 1).tolist()

    def placed(lines: FloatArray) -> list[list[float]]:
        pixels = scale * (lines - low)
        pixels[..., 1] = height - pixels[..., 1]
        return [[round(float(end), 1) for end in line] for line in pixels.reshape(len(lines), -1)]

    largest = max([1e-3, *filter(is_number, values)])
    drawn: list[dict[str, Any]] = []
    rows = zip(joints, values, placed(axes), strict=True)
    for joint, value, axis in sorted(rows, key=lambda row: row[2][1] + row[2][3]):
        x, y = 0.5 * (axis[0] + axis[2]), 0.5 * (axis[1] + axis[3])
        label = f"{joint}: {percent(value)}"
        line = max(y, drawn[-1]["line"] + _LINE) if drawn else y
        share = value / largest if is_number(value) else 0.0
        drawn.append(
            {"x": x, "y": y, "line": line, "axis": axis, "colour": _colour(share), "label": label}
        )
    words = ", ".join(joint["label"] for joint in drawn)
    return {
        "title": title,
        "lines": placed(segments),
        "joints": drawn,
        "column": width + _COLUMN,
        "width": width + _COLUMN + _LETTER * max(len(joint["label"]) for joint in drawn) + 40,
        "height": max(height, drawn[-1]["line"]) + 40,
        "words": f"Robot with each joint in the colour of its {title}: {words}",
    }


def _project(point: FloatArray) -> FloatArray:
    """Return the orthographic projection (2,) of a point: right and up."""
    turned = np.cos(_AZIMUTH) * point[1] - np.sin(_AZIMUTH) * point[0]
    toward = np.cos(_AZIMUTH) * point[0] + np.sin(_AZIMUTH) * point[1]
    return np.array([turned, np.cos(_ELEVATION) * point[2] - np.sin(_ELEVATION) * toward])


def _colour(share: float) -> str:
    """Return the CSS colour of a share from 0 to 1, between those of `_COLOURS`."""
    places = [place for place, _ in _COLOURS]
    parts = zip(*(colour for _, colour in _COLOURS), strict=True)
    mixed = [round(float(np.interp(share, places, part))) for part in parts]
    return f"rgb({', '.join(map(str, mixed))})"


def _frame(report: Report[R], **context: Any) -> dict[str, Any]:
    """Return variables of the template with the drawing of the robot."""
    return {"robot": _shaded_robot(report), "missing": report.nominal.missing, **context}


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
        badge=verdict_of(result),
        headline=diagnosis_headline(result),
        steps=diagnosis_steps(report),
        lacking=[
            lacking_row(result, cause) for cause in result.causes if cause.kind == "structural"
        ],
        wrong=wrong_numbers(result),
        differing=difference_rows(result),
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
