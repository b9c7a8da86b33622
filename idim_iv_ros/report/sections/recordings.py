"""One recording: its signals, its clocks, and what had to be repaired."""

from pathlib import Path

from idim_iv_ros.identification.result import BagSummary
from idim_iv_ros.recording import ClockQuality
from idim_iv_ros.report.markup import Html, bullets, join, tag
from idim_iv_ros.report.numerals import cell, count, exact, with_unit


def recording_block(bag: BagSummary) -> Html:
    """Return what is known of one recording."""
    size = f"{with_unit(bag.duration, 's', 4)} at {exact(bag.rate, 'Hz')}"
    notes = [
        join(
            f"{note.topic}: " if note.topic else "",
            note.what,
            f" ({count(note.count)}×)" if note.count > 1 else "",
        )
        for note in bag.notes
    ]
    notes += [join(each.sentence) for each in bag.frozen]
    return tag(
        "div",
        tag("h3", "Recording ", tag("code", Path(bag.path).name)),
        tag(
            "p",
            f"{size}, {count(bag.samples)} samples on a uniform grid. ",
            f"Signals: {', '.join(bag.signals)}." if bag.signals else None,
            tag("br"),
            tag("small", bag.path),
        ),
        _clocks(bag.clocks) if bag.clocks else None,
        bullets(notes) or tag("p", "Nothing had to be repaired, reordered or left out."),
        css="recording",
    )


def _clocks(clocks: tuple[ClockQuality, ...]) -> Html:
    heads = (
        ("Topic", None),
        ("Clock", None),
        ("Messages", "num"),
        ("Rate", "num"),
        ("Jitter (σ)", "num"),
        ("Longest interval", "num"),
        ("Gaps", "num"),
        ("Repeated stamps", "num"),
        ("Backward stamps", "num"),
    )
    rows = [
        tag(
            "tr",
            tag("th", tag("code", clock.topic), scope="row"),
            tag("td", "header stamps" if clock.source == "header" else "arrival time"),
            cell(count(clock.messages)),
            cell(with_unit(clock.rate, "Hz", 4)),
            cell(_seconds(clock.jitter)),
            cell(_seconds(clock.longest_gap)),
            cell(count(clock.gaps)),
            cell(count(clock.repeated)),
            cell(count(clock.backward)),
        )
        for clock in clocks
    ]
    head = [tag("th", text, scope="col", css=css) for text, css in heads]
    table = tag("table", tag("thead", tag("tr", head)), tag("tbody", rows), css="clocks")
    return tag("div", table, css="wide")


def _seconds(value: float) -> str:
    # Less than a nanosecond is rounding: ROS stamps hold no more.
    if value < 1e-9:
        return "0"
    if value < 1e-3:
        return with_unit(1e6 * value, "µs")
    return with_unit(1e3 * value, "ms") if value < 1.0 else with_unit(value, "s")
