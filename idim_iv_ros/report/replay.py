"""The page of a replay: tracking error and torque of every stage beside the recording."""

from functools import partial

import numpy as np

from idim_iv_ros.model.parameters import unit_at
from idim_iv_ros.report.advice import Step
from idim_iv_ros.report.figures import BLUE, GREY, INK, ORANGE, Figure, TimeCurve, over_time
from idim_iv_ros.report.numerals import number, plural, round_number, with_unit
from idim_iv_ros.report.page import one_section, page_html
from idim_iv_ros.report.section import UNPLACED, Files
from idim_iv_ros.report.sections.torque import Bar
from idim_iv_ros.report.time_axis import peaks
from idim_iv_ros.simulators.replay_result import (
    CORRECTED,
    NOMINAL,
    WITH_EFFECTS,
    ReplayError,
    ReplayResult,
    ReplaySeries,
)

_COLOURS = {NOMINAL: GREY, CORRECTED: ORANGE, WITH_EFFECTS: BLUE}
_TOOL = "end of the arm"
_MODELS = {CORRECTED: "with what was found", WITH_EFFECTS: "with what was found and its effects"}
_ON = {
    True: " That was found on other recordings.",
    False: " That was found on these recordings: replay others, too.",
    None: "",
}
_HEIGHT = 340
_BUCKETS = 220


def replay_html(result: ReplayResult, files: Files = UNPLACED) -> str:
    """Return the report of a replay as one self-contained HTML document."""
    drawn = [stage.name for stage in result.stages if stage.tracking is not None]
    section = one_section(
        "replay.html.j2",
        "replay",
        "Replay",
        result=result,
        badge=badge(result),
        headline=headline(result),
        steps=steps(result, files),
        shrinkage=shrinkage(result),
        columns=["Joint", *([name, "num"] for name in drawn), ["Noise", "num"]],
        tracking=error_rows(result, "tracking"),
        torque=error_rows(result, "torque"),
        legend=[("line", _COLOURS[name], f"simulated, {name}") for name in drawn],
        figure=partial(_replay_figure, result),
    )
    seconds, joints = with_unit(result.duration, "s"), plural(len(result.joints), "joint")
    of = f"References of {seconds} of recording, {joints}"
    return page_html(result.robot, "replay in MuJoCo", of, [section])


# Joint or tool, bars, noise, nominal error, error of the best stage, and their ratio.
Row = tuple[str, tuple[Bar, ...], Bar | None, str, str, str]


def shrinkage(result: ReplayResult) -> list[Row]:
    """Return rows with the nominal error and what the best stage leaves of it: joints and tool."""
    first, last = result.stages[0], result.best
    if first.tracking is None or last.tracking is None or last is first:
        return []
    units = [unit_at("mrad", kind) for kind in result.joint_types]
    pairs = [
        (name, first.tracking[name], last.tracking[name], result.tracking_noise[name], unit)
        for name, unit in zip(result.joints, units, strict=True)
    ]
    if first.tool is not None and last.tool is not None:
        pairs.append((_TOOL, first.tool, last.tool, 0.0, "mm"))
    rows: list[Row] = []
    for name, before, after, noise, unit in pairs:
        longest = max(before.rms, after.high, 1e-300)
        bars = (
            ("full given", 0.0, before.rms / longest),
            ("full effect", 0.0, after.rms / longest),
            ("whisker", after.low / longest, after.high / longest),
        )
        floor = ("full floor", 0.0, noise / longest) if 0.0 < noise < longest else None
        half = 0.5e3 * (after.high - after.low)
        shown = [f"{1e3 * before.rms:.3g} {unit}", f"{1e3 * after.rms:.3g} ± {half:.1g} {unit}"]
        ratio = f"{100.0 * after.rms / max(before.rms, 1e-300):.3g} %"
        rows.append((name, bars, floor, shown[0], shown[1], ratio))
    return rows


def headline(result: ReplayResult) -> str:
    """Return a sentence on how far the tracking of the best stage is from the robot's."""
    first, last = result.stages[0], result.best
    if last.tracking is None:
        return "No stage could be simulated to its end."
    if first.tracking is None:
        return f"The nominal model cannot follow the references; {last.name} does."
    rows = shrinkage(result)
    if not rows:
        return "Only the nominal model was simulated."
    name, _, _, before, after, _ = rows[-1]
    end = "The end of the simulated arm" if name == _TOOL else f"Simulated {name}"
    return (
        f"{end} is {before} from the robot's in the nominal model, and {after} (95 %) in the model "
        f"{_MODELS[last.name]}.{_ON[result.held_out]}"
    )


def badge(result: ReplayResult) -> tuple[str, str, str]:
    """Return a badge: is the best stage significantly closer to the robot than the nominal one?"""
    before, after = result.stages[0], result.best
    if after.tracking is None:
        return "bad", "✕", "not simulated"
    if before.tracking is None:
        return "good", "✓", f"only {after.name} follows"
    if after is before:
        return "open", "?", "nothing to compare with"
    pairs = [(before.tracking[name], after.tracking[name]) for name in result.joints]
    if before.tool is not None and after.tool is not None:
        pairs = [(before.tool, after.tool)]
    if all(best.high < nominal.rms for nominal, best in pairs):
        return "good", "✓", "the corrected simulator is closer to the robot"
    if any(best.low > nominal.rms for nominal, best in pairs):
        return "bad", "✕", "the corrected simulator is farther from the robot"
    return "open", "≈", "no clear difference"


def steps(result: ReplayResult, files: Files) -> list[Step]:
    """Return the next steps after a replay: use the result, or diagnose why it is no closer."""
    bags = files.recordings(result.bags)
    if result.best.tracking is None:
        return [Step("Check the recordings and the control law:", files.command("check", *bags))]
    effects = ("--effects", result.effects) if result.effects else ()
    other = files.again("replay", "--model", result.model, *effects, out="verified")
    if badge(result)[0] != "good":
        if result.held_out is False:
            return [Step("Record another motion, which may show the difference better:", other)]
        diagnosis = files.command("diagnose", *bags, out="why_replayed")
        return [Step("Find out what this simulator lacks on these recordings:", diagnosis)]
    todo = [Step("Record another motion, and see whether the simulator is as close there:", other)]
    if result.held_out is not None and result.model == "urdf":  # a diagnosis was replayed
        line = files.command("export", result.effects, "--refit", out="simulator")
        todo.insert(0, Step("Put what was found into your simulator:", line))
    return todo


def error_rows(result: ReplayResult, kind: str) -> list[list[str]]:
    """Return table rows: joint, error of each stage, noise; `kind` is tracking or torque."""
    rows, noise, scale, revolute = [], result.torque_noise, 1.0, "N m"
    if kind == "tracking":
        noise, scale, revolute = result.tracking_noise, 1e3, "mrad"
    errors: list[dict[str, ReplayError] | None] = [getattr(stage, kind) for stage in result.stages]
    for joint, joint_type in zip(result.joints, result.joint_types, strict=True):
        unit = unit_at(revolute, joint_type)
        cells = [error_words(of[joint], scale, unit) for of in errors if of is not None]
        rows.append([joint, *cells, f"{number(scale * noise[joint])} {unit}"])
    if kind == "tracking":
        tools = [stage.tool for stage in result.stages if stage.tool is not None]
        rows.append([_TOOL, *(error_words(tool, 1e3, "mm") for tool in tools), "–"])
    return rows


def error_words(error: ReplayError, scale: float, unit: str) -> str:
    """Return an error times `scale`, half-width of its 95 % interval, and ratio to the noise."""
    half, times = 0.5 * scale * (error.high - error.low), round_number(error.over_noise, 2)
    of_noise = f" ({times} × noise)" if np.isfinite(error.over_noise) else ""
    return f"{scale * error.rms:.3g} ± {half:.1g} {unit}{of_noise}"


def _replay_figure(result: ReplayResult, series: ReplaySeries, index: int) -> Figure:
    joint_type = result.joint_types[result.joints.index(series.joint)]
    small, torque_unit = unit_at("mrad", joint_type), unit_at("N m", joint_type)
    chosen = peaks([series.error, *series.errors.values(), series.torque], _BUCKETS)
    # The robot is drawn last: thin, above the wider simulations.
    torques = {**series.torques, "robot": series.torque}
    drawn = []
    for name, error in {**series.errors, "robot": series.error}.items():
        colour, width = (_COLOURS[name], 1.8) if name in _COLOURS else (INK, 0.9)
        size = f"{name} %{{y:.3g}}"
        drawn.append(TimeCurve(1e3 * error[chosen], colour, width, f"{size} {small}"))
        torque = torques[name][chosen]
        drawn.append(TimeCurve(torque, colour, width, f"{size} {torque_unit}", below=True))
    return over_time(
        f"replay-{index}",
        _HEIGHT,
        f"Tracking error and torque of {series.joint}, robot and simulations, over time",
        series.time[chosen],
        drawn,
        (f"Error, {small}", f"Torque, {torque_unit}"),
        0.54,
    )
