"""The waterfall: nominal model, refit, effect by effect, noise floor; each joint by itself."""

from idim_iv_ros.diagnosis.result import GapResult, JointGap, Stage
from idim_iv_ros.report.gap_words import small_unit, stage_words, torque_unit
from idim_iv_ros.report.markup import Html, bullets, join, section, tag
from idim_iv_ros.report.numerals import cell, known, number

_COLOURS = {"given": "given", "refit": "refit"}


def stages_section(result: GapResult) -> Html | None:
    """Return one waterfall for each joint, or None without stages."""
    if not result.stages:
        return None
    floors = {each.joint: each for each in result.joint_gaps}
    blocks = [_joint(result, joint, floors.get(joint)) for joint in result.joints]
    return section(
        "How far the gap shrinks",
        "stages",
        tag(
            "p",
            "Torque that each model leaves unexplained (rms), on data that was not used to fit "
            "it; the whisker is the 95 % interval by a bootstrap over blocks of time. The pale "
            "part of a bar is what the step removed. The tracking error is the difference "
            "between the simulated and the recorded motion, closed loop, same references. The "
            "dashed line is the noise floor: no model can pass it.",
            css="explanation",
        ),
        tag("div", blocks, css="grid one" if len(blocks) == 1 else "grid two"),
        bullets(_remarks(result.stages)),
    )


def _remarks(stages: tuple[Stage, ...]) -> list[str]:
    """Notes of the stages, each once, with the models that it is about."""
    about: dict[str, list[str]] = {}
    for stage in stages:
        if stage.note:
            about.setdefault(stage.note, []).append(stage_words(stage.name))
    return [
        f"{'all models' if len(names) == len(stages) else ', '.join(names)}: {note}"
        for note, names in about.items()
    ]


def _joint(result: GapResult, joint: str, gap: JointGap | None) -> Html:
    floor = None if gap is None else gap.noise_floor
    largest = _largest(result.stages, joint, floor)
    rows, previous = [], None
    for stage in result.stages:
        value = stage.torque_rms.get(joint)
        rows.append(_row(stage, joint, previous, largest, floor))
        previous = value if known(value) else previous
    rows.append(_floor_row(floor, largest, gap))
    unit, small = torque_unit(result, joint), small_unit(result, joint)
    heads = (
        ("Model", None),
        ("", "bar"),
        (f"Torque, {unit}", "num"),
        ("95 %", "num"),
        (f"Tracking, {small}", "num"),
    )
    head = tag("tr", [tag("th", text, scope="col", css=css) for text, css in heads])
    table = tag("table", tag("thead", head), tag("tbody", rows), css="waterfall")
    return tag("div", tag("h3", joint), tag("div", table, css="wide"), css="plot")


def _largest(stages: tuple[Stage, ...], joint: str, floor: float | None) -> float:
    ends = [floor or 0.0]
    for stage in stages:
        value = stage.torque_rms.get(joint)
        high = stage.torque_ci95.get(joint, (0.0, 0.0))[1]
        ends += [each for each in (value, high) if each is not None and known(each)]
    return 1.04 * max(ends) or 1.0


def _row(
    stage: Stage, joint: str, previous: float | None, largest: float, floor: float | None
) -> Html:
    value = stage.torque_rms.get(joint)
    interval = stage.torque_ci95.get(joint)
    tracking = None if stage.tracking_rms is None else stage.tracking_rms.get(joint)
    return tag(
        "tr",
        tag("th", stage_words(stage.name), scope="row"),
        tag(
            "td",
            _bar(stage, value, interval, previous, largest),
            _floor_line(floor, largest),
            css="bar",
        ),
        cell(number(value)),
        tag("td", _interval(interval), css="num quiet"),
        cell(number(None if tracking is None else 1e3 * tracking)),
    )


def _bar(
    stage: Stage,
    value: float | None,
    interval: tuple[float, float] | None,
    previous: float | None,
    largest: float,
) -> Html:
    parts = []
    if value is not None and known(value):
        colour = _COLOURS.get(stage.name, "effect")
        parts.append(_span(f"full {colour}", 0.0, value / largest))
        if previous is not None and previous > value:
            parts.append(_span(f"gone {colour}", value / largest, previous / largest))
        if interval is not None and known(interval[0]) and known(interval[1]):
            parts.append(_span("whisker", interval[0] / largest, interval[1] / largest))
    return tag("div", parts, css="track")


def _floor_row(floor: float | None, largest: float, gap: JointGap | None) -> Html:
    bar = [_span("full floor", 0.0, floor / largest)] if floor is not None else []
    origin = "" if gap is None else gap.floor_origin
    return tag(
        "tr",
        tag("th", "noise floor", scope="row"),
        tag("td", tag("div", bar, css="track"), _floor_line(floor, largest), css="bar"),
        cell(number(floor)),
        tag("td", tag("small", origin if floor is not None else "unknown"), colspan="2"),
        css="floor",
    )


def _floor_line(floor: float | None, largest: float) -> Html | None:
    return None if floor is None else _span("floor-line", floor / largest, floor / largest)


def _span(css: str, low: float, high: float) -> Html:
    return tag("i", css=css, style=f"left:{100.0 * low:.2f}%;width:{100.0 * (high - low):.2f}%")


def _interval(interval: tuple[float, float] | None) -> Html:
    if interval is None or not (known(interval[0]) and known(interval[1])):
        return join("–")
    return join(f"{number(interval[0])} … {number(interval[1])}")
