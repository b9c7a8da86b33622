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
_LINE, _LETTER = 17.0, 8.0  # pixels: height of a label, and width of a letter in it
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

    The robot fits into a rectangle with a corner at 0, 0; labels stand to the right of the joints.
    Lines are (x1, y1, x2, y2), pixels, y downwards.
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
    scale = min(width, height) / max(float((high - low).max()), 1e-9)
    shift = 0.5 * (np.array([width, height]) - scale * (high - low))

    def placed(lines: FloatArray) -> list[list[float]]:
        pixels = shift + scale * (lines - low)
        pixels[..., 1] = height - pixels[..., 1]
        return [[round(float(end), 1) for end in line] for line in pixels.reshape(len(lines), -1)]

    largest = max([value for value in values if value is not None and is_number(value)] + [1e-3])
    drawn: list[dict[str, Any]] = []
    rows = zip(joints, values, placed(axes), strict=True)
    for joint, value, axis in sorted(rows, key=lambda row: row[2][1] + row[2][3]):
        x, y = 0.5 * (axis[0] + axis[2]), 0.5 * (axis[1] + axis[3])
        line = y
        # Labels of joints at one place stand below each other.
        while any(abs(other["line"] - line) < _LINE for other in drawn):
            line += _LINE
        share = value / largest if value is not None and is_number(value) else 0.0
        label = f"{joint}: {percent(value)}"
        drawn.append(
            {"x": x, "y": y, "line": line, "axis": axis, "colour": _colour(share), "label": label}
        )
    words = ", ".join(joint["label"] for joint in drawn)
    return {
        "title": title,
        "lines": placed(segments),
        "joints": drawn,
        "width": max(width, *(joint["x"] + _LETTER * len(joint["label"]) for joint in drawn)) + 40,
        "height": max(height, *(joint["line"] for joint in drawn)) + 40,
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
