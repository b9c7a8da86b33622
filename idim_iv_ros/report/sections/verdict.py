"""The answer of a report: findings, next steps, drawing of the robot, causes, what changed."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.effects.cause import surest
from idim_iv_ros.excitation.diagnosis import separating_motion
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.report.advice import (
    BADGES,
    FAMILIES,
    contrast_headline,
    contrast_steps,
    diagnosis_headline,
    diagnosis_steps,
    difference_rows,
    identification_headline,
    identification_steps,
)
from idim_iv_ros.report.gap_words import (
    contrast_badge,
    hint_words,
    lacking_row,
    verdict_of,
    wrong_numbers,
)
from idim_iv_ros.report.numerals import is_number, percent
from idim_iv_ros.report.section import R, Report
from idim_iv_ros.types import FloatArray

# Half of the length that is drawn of a joint's axis: of the robot's size, and m where it has none.
_AXIS, _AXIS_ALONE = 0.07, 0.2
_SIZE = 330.0  # pixels of the robot's longer side
_COLUMN, _LINE, _LETTER = 30.0, 18.0, 8.0  # pixels: to the labels, height and letter of one
_AZIMUTH, _ELEVATION = np.radians(-55.0), np.radians(20.0)


def _robot(report: Report[R]) -> dict[str, Any] | None:
    """Return the variables of the macro ``robot``; None where the robot cannot be drawn.

    The robot has a corner at 0, 0; labels are in a column to the right of it. Lines are (x1, y1,
    x2, y2), pixels, y downwards.
    """
    skeleton, result = report.nominal.skeleton, report.result
    if skeleton is None:
        return None
    values: Mapping[str, float | None]
    if isinstance(result, GapResult):
        values = {joint_gap.joint: 100.0 * joint_gap.share for joint_gap in result.where.joints}
        title = "share of the gap"
    else:
        values = result.fit.joint_relative_error_percent
        title = "relative error of the torque"
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

    largest = max([1e-3, *filter(is_number, values.values())])
    drawn: list[dict[str, Any]] = []
    rows = zip(result.joints, placed(axes), strict=True)
    for joint, axis in sorted(rows, key=lambda row: row[1][1] + row[1][3]):
        value = values.get(joint)
        x, y = 0.5 * (axis[0] + axis[2]), 0.5 * (axis[1] + axis[3])
        label = f"{joint}: {percent(value)}"
        line = max(y, drawn[-1]["line"] + _LINE) if drawn else y
        share = value / largest if is_number(value) else 0.0
        drawn.append({"x": x, "y": y, "line": line, "axis": axis, "share": share, "label": label})
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


def _frame(report: Report[R], **context: Any) -> dict[str, Any]:
    return {"robot": _robot(report), "missing": report.nominal.missing, **context}


def identification(report: Report[IdentificationResult]) -> dict[str, Any]:
    """Return what the section on the verdict of an identification shows."""
    result = report.result
    return _frame(
        report,
        badge=BADGES[result.verdict.verdict],
        headline=identification_headline(result),
        steps=identification_steps(report),
        badge_of=BADGES.get,
    )


def diagnosis(report: Report[GapResult]) -> dict[str, Any]:
    """Return what the section on the verdict of a diagnosis shows."""
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
        model="nominal model" if nominal else "refit",
    )


def causes(report: Report[GapResult]) -> dict[str, Any]:
    """Return what the section on the causes shows."""
    rest, hints = report.result.unexplained, report.result.hints
    likeliest = None if rest is None else rest.likeliest(hints)
    return {
        "separating_motion": separating_motion,
        "surest": surest,
        "family": "" if rest is None else FAMILIES[rest.family],
        "likeliest": likeliest and hint_words(likeliest),
    }


def contrast(report: Report[GapResult]) -> dict[str, Any] | None:
    """Return what the section on the second set of recordings shows; None without one."""
    changed = report.result.contrast
    if changed is None:
        return None
    return {
        "badge": contrast_badge(changed),
        "headline": contrast_headline(changed),
        "steps": contrast_steps(changed, report.files),
    }
