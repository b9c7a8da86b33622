"""Drawing of the robot beside the answer of a report, each joint in the colour of its part."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.report.numerals import is_number, percent
from idim_iv_ros.report.section import Report
from idim_iv_ros.types import FloatArray

# Half of the length that is drawn of a joint's axis: of the robot's size, and m where it has none.
_AXIS, _AXIS_ALONE = 0.07, 0.2
_SIZE = 330.0  # pixels of the robot's longer side
_COLUMN, _LINE, _LETTER = 30.0, 18.0, 8.0  # pixels: to the labels, height and letter of one
_AZIMUTH, _ELEVATION = np.radians(-55.0), np.radians(20.0)
# Of the orthographic projection: to the right, toward the eye along the ground, and up.
_RIGHT = np.array([-np.sin(_AZIMUTH), np.cos(_AZIMUTH), 0.0])
_TOWARD = np.array([np.cos(_AZIMUTH), np.sin(_AZIMUTH), 0.0])
_UP = np.array([0.0, 0.0, np.cos(_ELEVATION)]) - np.sin(_ELEVATION) * _TOWARD


def robot_drawing(report: Report[Any]) -> dict[str, Any] | None:
    """Return the variables of the macro ``robot``; None where the robot cannot be drawn.

    The robot has a corner at 0, 0; labels are in a column to the right of it. Lines are (x1, y1,
    x2, y2), pixels, y downwards.
    """
    skeleton, result = report.nominal.skeleton, report.result
    if skeleton is None:
        return None
    values: Mapping[str, float | None]
    if isinstance(result, GapResult):
        values = {gap.joint: 100.0 * gap.share for gap in result.where.joints}
        title = "share of the gap"
    else:
        values = result.fit.joint_relative_error_percent
        title = "relative error of the torque"
    segments = np.array(skeleton.segments)
    size = float(np.ptp(segments.reshape(-1, 3), axis=0).max())
    half = (_AXIS * size or _AXIS_ALONE) * skeleton.axes
    axes = np.stack([skeleton.origins - half, skeleton.origins + half], axis=1)
    segments, axes = (lines @ np.column_stack([_RIGHT, _UP]) for lines in (segments, axes))
    corners = np.concatenate([segments, axes]).reshape(-1, 2)
    low, high = corners.min(axis=0), corners.max(axis=0)
    extent = np.maximum(high - low, 1e-9)
    scale = _SIZE / float(extent.max())
    width, height = np.round(scale * extent, 1).tolist()

    def placed(lines: FloatArray) -> list[list[float]]:
        pixels = scale * (lines - low)
        pixels[..., 1] = height - pixels[..., 1]
        rounded: list[list[float]] = np.round(pixels.reshape(len(lines), -1), 1).tolist()
        return rounded

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
