"""The robot as joints and lines between them, each joint in the colour of a share."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from idim_iv_ros.model.skeleton import Skeleton
from idim_iv_ros.report.figures import GREY, INK, Figure, layout
from idim_iv_ros.report.numerals import is_number, percent
from idim_iv_ros.types import FloatArray

# From little to much; distinguished on white and on black, and by lightness.
_COLOURS = ((0.0, (154, 181, 204)), (0.45, (240, 170, 95)), (1.0, (190, 52, 20)))
# Half of the length that is drawn of a joint's axis: of the robot's size, and m where it has none.
_AXIS, _AXIS_ALONE = 0.07, 0.2
_LABEL = 17.0  # pixels: height of the words beside a joint there
_SPACE = "\N{NO-BREAK SPACE}"
_AZIMUTH, _ELEVATION = np.radians(-55.0), np.radians(20.0)  # of the flat drawing


@dataclass(frozen=True)
class ShadedRobot:
    """A robot, a value in percent for each joint, and the title of the colour bar."""

    skeleton: Skeleton
    joints: tuple[str, ...]
    values: tuple[float | None, ...]
    title: str

    @property
    def largest(self) -> float:
        """End of the colour bar, percent."""
        return max(
            [value for value in self.values if value is not None and is_number(value)] + [1e-3]
        )

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Corners of the box around all joints and ends, (3,) each, m."""
        points = np.array([point for line in self.skeleton.segments for point in line])
        return points.min(axis=0), points.max(axis=0)

    def axis_of(self, joint: int) -> tuple[FloatArray, FloatArray]:
        """Ends of the part of a joint's axis that is drawn, (3,) each, m."""
        low, high = self.bounds
        half = (_AXIS * float((high - low).max()) or _AXIS_ALONE) * self.skeleton.axes[joint]
        origin = self.skeleton.origins[joint]
        return origin - half, origin + half

    def label(self, joint: int) -> str:
        """Name and value of a joint."""
        return f"{self.joints[joint]}: {percent(self.values[joint])}"


def robot_figure(robot: ShadedRobot, height: int = 380) -> Figure:
    """Return the robot in three dimensions, to be turned with the pointer."""
    lines = _with_breaks(robot.skeleton.segments)
    axes = _with_breaks([robot.axis_of(joint) for joint in range(len(robot.joints))])
    origins = robot.skeleton.origins
    scale = [[place, f"rgb{colour}"] for place, colour in _COLOURS]
    names = [joint.replace("&", "&amp;").replace("<", "&lt;") for joint in robot.joints]
    # Words at one place would cover each other: the last of joints that share it names all.
    labels = list(names)
    for joint in range(len(names) - 1):
        if np.allclose(origins[joint], origins[joint + 1], atol=1e-6):
            labels[joint + 1] = f"{labels[joint]}, {labels[joint + 1]}"
            labels[joint] = ""
    data: list[dict[str, Any]] = [
        _scatter(lines, mode="lines", line={"color": GREY, "width": 9}, hoverinfo="skip"),
        _scatter(axes, mode="lines", line={"color": INK, "width": 3}, hoverinfo="skip"),
        _scatter(
            np.zeros((1, 3)),
            mode="markers",
            marker={"size": 11, "symbol": "square", "color": GREY},
            hovertemplate="base<extra></extra>",
        ),
        _scatter(
            origins,
            mode="markers+text",
            text=[f"{_SPACE * 4}{label}" for label in labels],
            textposition="middle right",
            textfont={"size": 12, "color": INK},
            customdata=[robot.label(joint) for joint in range(len(names))],
            marker={
                "size": 13,
                "color": [value if is_number(value) else None for value in robot.values],
                "colorscale": scale,
                "cmin": 0.0,
                "cmax": robot.largest,
                "line": {"color": INK, "width": 1},
                "colorbar": {
                    "title": {"text": f"{robot.title}, %", "side": "right", "font": {"size": 12}},
                    "thickness": 12,
                    "len": 0.8,
                    "x": 1.0,
                    "outlinewidth": 0,
                    "tickfont": {"size": 11},
                },
            },
            hovertemplate=f"%{{customdata}} ({robot.title})<extra></extra>",
        ),
    ]
    low, high = robot.bounds
    half = 0.5 * max(float((high - low).max()), 2.0 * _AXIS_ALONE)
    scene: dict[str, Any] = {
        f"{letter}axis": {"visible": False, "range": [float(middle - half), float(middle + half)]}
        for letter, middle in zip("xyz", 0.5 * (low + high), strict=True)
    }
    scene |= {"aspectmode": "cube", "camera": {"eye": {"x": 0.95, "y": -1.2, "z": 0.5}}}
    description = f"Robot with each joint in the colour of its {robot.title}: " + ", ".join(
        robot.label(joint) for joint in range(len(robot.joints))
    )
    margin = {"l": 0, "r": 0, "t": 0, "b": 0}
    return Figure(
        "robot", height, description, data, layout({}, scene=scene, margin=margin, dragmode="orbit")
    )


def _scatter(points: FloatArray, **options: object) -> dict[str, Any]:
    columns = [
        [None if np.isnan(value) else round(float(value), 5) for value in column]
        for column in points.T
    ]
    return {"type": "scatter3d", "x": columns[0], "y": columns[1], "z": columns[2], **options}


def _with_breaks(lines: Sequence[tuple[FloatArray, FloatArray]]) -> FloatArray:
    """Points (3 n, 3) of lines with NaN between them."""
    apart = np.full(3, np.nan)
    return np.array([point for start, end in lines for point in (start, end, apart)])


def flat_robot(robot: ShadedRobot, width: float, height: float) -> dict[str, list[Any]]:
    """Return the robot as a flat drawing that fits into a rectangle with its lower left at 0, 0.

    Lines are (x1, y1, x2, y2), pixels, y downwards. Of a joint: its place, the ends of its axis,
    its colour and words, and the side of the words, 1 to the right, -1 to the left.
    """
    segments = [(_flat(start), _flat(end)) for start, end in robot.skeleton.segments]
    axes = [tuple(map(_flat, robot.axis_of(joint))) for joint in range(len(robot.joints))]
    points = np.array([point for line in [*segments, *axes] for point in line])
    low, high = points.min(axis=0), points.max(axis=0)
    scale = min(width, height) / max(float((high - low).max()), 1e-9)
    shift = 0.5 * (np.array([width, height]) - scale * (high - low))

    def place(point: FloatArray) -> tuple[float, float]:
        x, y = shift + scale * (point - low)
        return round(float(x), 1), round(float(height - y), 1)

    joints: list[dict[str, Any]] = []
    for joint, (start, end) in enumerate(axes):
        x, y = place(_flat(robot.skeleton.origins[joint]))
        taken = any(other["side"] > 0 and abs(other["y"] - y) < _LABEL for other in joints)
        joints.append(
            {
                "x": x,
                "y": y,
                "axis": (*place(start), *place(end)),
                "colour": _colour((robot.values[joint] or 0.0) / robot.largest),
                "label": robot.label(joint),
                "side": -1 if taken else 1,
            }
        )
    return {"lines": [(*place(start), *place(end)) for start, end in segments], "joints": joints}


def _flat(point: FloatArray) -> FloatArray:
    """Orthographic projection (2,): right and up."""
    turned = np.cos(_AZIMUTH) * point[1] - np.sin(_AZIMUTH) * point[0]
    toward = np.cos(_AZIMUTH) * point[0] + np.sin(_AZIMUTH) * point[1]
    return np.array([turned, np.cos(_ELEVATION) * point[2] - np.sin(_ELEVATION) * toward])


def _colour(share: float) -> str:
    places = [place for place, _ in _COLOURS]
    parts = zip(*(colour for _, colour in _COLOURS), strict=True)
    mixed = [round(float(np.interp(share, places, part))) for part in parts]
    return f"rgb({', '.join(map(str, mixed))})"


def colour_bar() -> list[tuple[float, str]]:
    """Return places from 0 to 1 along the colour bar and their colours."""
    return [(place, f"rgb{colour}") for place, colour in _COLOURS]
