"""The robot as joints and lines between them, each joint in the colour of a share."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from idim_iv_ros.model.skeleton import Skeleton
from idim_iv_ros.report.numerals import is_number, percent
from idim_iv_ros.types import FloatArray

# From little to much; distinguished on white and on black, and by lightness.
_COLOURS = ((0.0, (154, 181, 204)), (0.45, (240, 170, 95)), (1.0, (190, 52, 20)))
# Half of the length that is drawn of a joint's axis: of the robot's size, and m where it has none.
_AXIS, _AXIS_ALONE = 0.07, 0.2
_COLUMN, _LINE, _LETTER = 30.0, 18.0, 8.0  # pixels: to the labels, height and letter of one
_AZIMUTH, _ELEVATION = np.radians(-55.0), np.radians(20.0)


def robot_drawing(
    skeleton: Skeleton,
    joints: Sequence[str],
    values: Sequence[float | None],
    title: str,
    width: float,
    height: float,
) -> dict[str, Any]:
    """Return what ``robot.svg.j2`` draws of a robot with a value in percent for each joint.

    The robot is as large as fits into `width` and `height`, with a corner at 0, 0; labels stand
    in a column to the right of it. Lines are (x1, y1, x2, y2), pixels, y downwards.
    """
    points = np.array([point for line in skeleton.segments for point in line])
    size = float(np.ptp(points, axis=0).max())
    half = (_AXIS * size or _AXIS_ALONE) * skeleton.axes
    ends = zip(skeleton.origins - half, skeleton.origins + half, strict=True)
    segments, axes = (
        np.array([[_projected(start), _projected(end)] for start, end in lines])
        for lines in (skeleton.segments, ends)
    )
    corners = np.concatenate([segments, axes]).reshape(-1, 2)
    low, high = corners.min(axis=0), corners.max(axis=0)
    extent = np.maximum(high - low, 1e-9)
    scale = float(np.min(np.array([width, height]) / extent))
    width, height = np.round(scale * extent, 1).tolist()

    def placed(lines: FloatArray) -> list[list[float]]:
        pixels = scale * (lines - low)
        pixels[..., 1] = height - pixels[..., 1]
        return [[round(float(end), 1) for end in line] for line in pixels.reshape(len(lines), -1)]

    largest = max([value for value in values if value is not None and is_number(value)] + [1e-3])
    drawn: list[dict[str, Any]] = []
    rows = zip(joints, values, placed(axes), strict=True)
    for joint, value, axis in sorted(rows, key=lambda row: row[2][1] + row[2][3]):
        x, y = 0.5 * (axis[0] + axis[2]), 0.5 * (axis[1] + axis[3])
        label = f"{joint}: {percent(value)}"
        line = max(y, drawn[-1]["line"] + _LINE) if drawn else y
        share = value / largest if value is not None and is_number(value) else 0.0
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


def _projected(point: FloatArray) -> FloatArray:
    """Orthographic projection (2,): right and up."""
    turned = np.cos(_AZIMUTH) * point[1] - np.sin(_AZIMUTH) * point[0]
    toward = np.cos(_AZIMUTH) * point[0] + np.sin(_AZIMUTH) * point[1]
    return np.array([turned, np.cos(_ELEVATION) * point[2] - np.sin(_ELEVATION) * toward])


def _colour(share: float) -> str:
    places = [place for place, _ in _COLOURS]
    parts = zip(*(colour for _, colour in _COLOURS), strict=True)
    mixed = [round(float(np.interp(share, places, part))) for part in parts]
    return f"rgb({', '.join(map(str, mixed))})"
