"""The page of an identification without torques: the servos, and how well they are simulated."""

from dataclasses import replace

import numpy as np

from idim_iv_ros.report.advice import Step
from idim_iv_ros.report.figures import BLUE, GREY, INK, Figure, TimeCurve, over_time
from idim_iv_ros.report.numerals import plural
from idim_iv_ros.report.page import one_section, page_html
from idim_iv_ros.report.section import UNPLACED, Files
from idim_iv_ros.servo.result import ServoNumber, ServoResult, ServoSeries

_HEIGHT = 260


def servo_html(result: ServoResult, files: Files = UNPLACED) -> str:
    """Return the report of servos as one self-contained HTML document."""
    section = one_section(
        "servo.html.j2",
        "servos",
        "Servos",
        result=result,
        badge=badge(result),
        headline=headline(result),
        steps=steps(result, files),
        columns=["", *([name, "num"] for name in SUMMARY_COLUMNS[1:])],
        summary=summary_rows(result),
        reasons=[f"{j.joint}: {j.reason}" for j in result.joints if j.reason],
        joints=[(j.joint, number_rows((*j.numbers, *j.ratios))) for j in result.joints],
        errors=error_rows(result),
        gains=gain_rows(result),
        figure=_servo_figure,
    )
    sizes = f"{plural(len(result.recordings), 'recording')}, {plural(len(result.joints), 'joint')}"
    return page_html(result.robot, "servos, without torques", sizes, [section])


_SUMMARY = {
    "stiffness": ("stiffness, N m/rad", 1.0),
    "armature": ("armature, kg m²", 1.0),
    "damping": ("damping, N m s/rad", 1.0),
    "dry friction": ("dry friction, N m", 1.0),
    "friction by load": ("friction by load", 1.0),
    "torque limit": ("torque limit, N m", 1.0),
    "delay": ("delay, ms", 1e3),
}
_NO_BOUND = 1e9  # of any number in its unit: the recording says nothing of it
SUMMARY_COLUMNS = ("joint", *(heading for heading, _ in _SUMMARY.values()))


def summary_rows(result: ServoResult) -> list[tuple[str, ...]]:
    """Return each joint's numbers with half-widths of 95 % intervals, or as upper bounds."""
    rows = []
    for joint in result.joints:
        cells = [joint.joint]
        for name, (_, scale) in _SUMMARY.items():
            number = joint.number(name)
            if (
                number is None
                or not np.isfinite(number.value)
                or number.high == 0.0
                or number.high >= _NO_BOUND
            ):
                cells.append("–")
            elif number.shown:
                half = _short(0.5 * scale * (number.high - number.low))
                cells.append(f"{scale * number.value:.3g} ± {half}")
            else:
                cells.append(f"< {_short(scale * number.high)}")
        rows.append(tuple(cells))
    return rows


def _short(value: float) -> str:
    """Return a number with one digit, without an exponent."""
    return f"{float(f'{value:.1g}'):g}"


def headline(result: ServoResult) -> str:
    """Return sentences on how many servos are identified in N m, and on their simulation error."""
    count, absolute = len(result.joints), sum(joint.absolute for joint in result.joints)
    worst = max(result.joints, key=lambda joint: joint.residual / max(joint.nominal, 1e-12))
    share = 100.0 * worst.residual / max(worst.nominal, 1e-12)
    where = f" (worst: {worst.joint})" if count > 1 else ""
    text = (
        f"{absolute} of {plural(count, 'servo')} known in N m{_stiffness_words(result)}. The "
        f"simulated motion is within {1e3 * worst.residual:.2g} mrad rms of the measured one, "
        f"{share:.2g} % of what perfect tracking misses{where}."
    )
    wrong = [check for check in result.gains if not check.agrees]
    if not wrong:
        return text
    check, more = wrong[0], f", and {len(wrong) - 1} more" if len(wrong) > 1 else ""
    return (
        f"{text} {check.recording} was said to have gain {check.given:.4g} at {check.joint}, and "
        f"behaves as {check.low:.4g} to {check.high:.4g}{more}."
    )


def _stiffness_words(result: ServoResult) -> str:
    """Return the least certain stiffness with its 95 % interval, to append to a sentence."""
    numbers = {joint.joint: joint.number("stiffness") for joint in result.joints}
    shown = {name: of for name, of in numbers.items() if of is not None and of.shown}
    if not shown:
        return ""
    widths = {name: (of.high - of.low) / of.value for name, of in shown.items()}
    joint = max(widths, key=widths.__getitem__)
    number, least = shown[joint], f" at {joint}, the least certain" if len(shown) > 1 else ""
    return (
        f": stiffness {number.value:.3g} ({number.low:.3g} to {number.high:.3g}, 95 %) "
        f"{number.unit}{least}"
    )


def badge(result: ServoResult) -> tuple[str, str, str]:
    """Return a badge: are the servos identified in N m, and do the given gains agree?"""
    absolute = [joint.absolute for joint in result.joints]
    if not all(check.agrees for check in result.gains):
        return "bad", "✕", "a gain is not what was given"
    if all(absolute):
        return "good", "✓", "known in N m"
    return ("fair", "≈", "partly known in N m") if any(absolute) else ("open", "?", "only ratios")


def steps(result: ServoResult, files: Files) -> list[Step]:
    """Return the next steps with the servos: simulate them, or record a motion with more load."""
    absolute = [joint.absolute for joint in result.joints]
    todo = []
    if any(absolute):
        written = replace(files, config=files.here("servo.yaml"))
        line = written.command("diagnose", *files.recordings(result.recordings), out="why")
        words = "servo.xml and servo_isaac_lab.py go into the simulator; see what it still lacks:"
        todo.append(Step(words, line))
    if not all(absolute):
        line = files.command("excite", "--for", "servo", out="motion")
        todo.append(Step("Record a motion with more load on the other servos:", line))
    return todo


def number_rows(numbers: tuple[ServoNumber, ...]) -> list[tuple[str, str, str]]:
    """Return name, value with unit and interval of numbers; in words where not identified."""
    rows = []
    for number in numbers:
        unit = number.unit.removeprefix("1")
        if number.shown:
            value = f"{number.value:.4g} {unit}".strip()
            interval = f"{number.low:.4g} to {number.high:.4g}"
        elif number.low == number.high == 0.0:
            value, interval = "no evidence", "–"
        elif number.high >= _NO_BOUND:
            value, interval = "not shown", "no bound"
        elif np.isfinite(number.value):
            value, interval = "not shown", f"{number.low:.2g} to {number.high:.2g} {unit}".strip()
        else:
            value, interval = "not reached", "–"
        rows.append((number.name, value, interval))
    return rows


def error_rows(result: ServoResult) -> list[tuple[str, ...]]:
    """Return position errors of each joint, mrad: nominal, fit, held out, encoder resolution."""
    rows = []
    for joint in result.joints:
        sizes = (joint.nominal, joint.residual, joint.held_out, joint.resolution)
        cells = ("–" if value is None else f"{1e3 * value:.3g}" for value in sizes)
        rows.append((joint.joint, *cells))
    return rows


def gain_rows(result: ServoResult) -> list[tuple[str, ...]]:
    """Return recording, joint, given gain, estimated gain, its interval, and whether they agree."""
    rows: list[tuple[str, ...]] = []
    for gain in result.gains:
        numbers = f"{gain.given:.4g}", f"{gain.estimated:.4g}", f"{gain.low:.4g} to {gain.high:.4g}"
        rows.append((gain.recording, gain.joint, *numbers, "agrees" if gain.agrees else "wrong"))
    return rows


def _servo_figure(series: ServoSeries, index: int) -> Figure:
    residual = 1e3 * (series.measured - series.simulated)
    return over_time(
        f"servo-{index}",
        _HEIGHT,
        f"Position of {series.joint}: asked for, measured and simulated, over time",
        series.time,
        [
            TimeCurve(series.command, GREY, 0.9, "asked %{y:.4g} rad"),
            TimeCurve(series.measured, INK, 1.2, "measured %{y:.4g} rad"),
            TimeCurve(series.simulated, BLUE, 1.2, "simulated %{y:.4g} rad"),
            TimeCurve(residual, BLUE, 0.9, "left %{y:.3g} mrad", below=True),
        ],
        ("Position, rad", "Left, mrad"),
        0.4,
    )
