"""A replay as one picture to show others: how far the simulated motion is, stage by stage."""

import textwrap
from pathlib import Path

from markupsafe import Markup

from idim_iv_ros.files import GENERATOR, FilePath
from idim_iv_ros.model.parameters import unit_at
from idim_iv_ros.report.numerals import number
from idim_iv_ros.report.page import environment
from idim_iv_ros.report.picture import HEIGHT, WIDTH, bars, save_picture
from idim_iv_ros.report.replay import headline
from idim_iv_ros.simulators.replay_result import CORRECTED, NOMINAL, WITH_EFFECTS, ReplayResult

_COLOURS = {NOMINAL: "#8a94a3", CORRECTED: "#d55e00", WITH_EFFECTS: "#0072b2"}
_LETTERS = 84  # of a line of the headline


def write_replay_picture(result: ReplayResult, path: FilePath) -> Path:
    """Write the summary of a replay as an SVG or PNG picture; raises as `write_picture`."""
    return save_picture(replay_svg(result), path)


def replay_svg(result: ReplayResult) -> str:
    """Return the picture as the text of an SVG file: the joint that is farthest off at first."""
    title, rows = "", []
    done = [stage for stage in result.stages if stage.tracking is not None]
    if done:
        errors = done[0].tracking or {}
        worst = max(result.joints, key=lambda joint: errors[joint].rms)
        unit = unit_at("mrad", result.joint_types[result.joints.index(worst)])
        title = f"Position of {worst}, simulation less recording (rms)"
        sizes = [(s.name, 1e3 * (s.tracking or {})[worst].rms, _COLOURS[s.name]) for s in done]
        sizes.append(("noise", 1e3 * result.tracking_noise[worst], "#b9c1cc"))
        rows = [(name, size, colour, f"{number(size)} {unit}") for name, size, colour in sizes]
    return environment().get_template("picture.svg.j2").render(
        generator=Markup(GENERATOR),
        robot_name=result.robot,
        badge=("fair", "", "replay in MuJoCo"),
        lines=textwrap.wrap(headline(result), _LETTERS),
        bars_title=title,
        bars=bars(rows),
        robot=None,
        robot_title="",
        largest="",
        stops=[],
        missing="",
        width=WIDTH,
        height=HEIGHT,
    )  # fmt: skip
