"""What was filtered and dropped, and what the reading of the recordings found."""

from collections import Counter
from collections.abc import Sequence

from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.report.markup import Html, bullets, section, sentence, tag
from idim_iv_ros.report.numerals import cell, count, exact, percent, with_unit
from idim_iv_ros.report.sections.recordings import recording_block
from idim_iv_ros.report.units import speed_unit


def processing_section(result: IdentificationResult) -> Html:
    """Return filters with their reasons, dropped samples, recordings and control law."""
    return section(
        "What was filtered and dropped",
        "processing",
        tag(
            "div",
            tag("div", _filters(result), _dropped(result)),
            _speeds(result),
            css="grid pair",
        ),
        tag("h3", "Decisions and their reasons") if result.processing.reasons else None,
        bullets(sentence(reason, result.joints) for reason in result.processing.reasons),
        tag("h3", "Control law") if result.controller else None,
        bullets(sentence(line, result.joints) for line in result.controller),
        [recording_block(bag) for bag in result.bags],
    )


def _filters(result: IdentificationResult) -> Html:
    used = result.processing
    order = f"Butterworth of order {used.position_order}, forward and backward (no phase)"
    rows = [
        ("Position filter", exact(used.position_cutoff, "Hz"), order),
        ("Derivatives", "", "central differences of the filtered position"),
        (
            "Decimation filter",
            exact(used.decimation_cutoff, "Hz"),
            "low-pass Chebyshev, the same on the torque and on every column",
        ),
        (
            "Decimation",
            _decimation(used.decimation_factors),
            f"leaves {exact(round(used.row_rate, 2), 'rows')} per second",
        ),
    ]
    body = [
        tag("tr", tag("th", name, scope="row"), cell(value), tag("td", note, css="words"))
        for name, value, note in rows
    ]
    return tag("table", tag("caption", "Filters"), tag("tbody", body), css="filters")


def _decimation(factors: Sequence[int]) -> str:
    kept = [f"1 of {each}" if each > 1 else "all" for each in dict.fromkeys(factors)]
    return "none" if kept == ["all"] else " or ".join(kept)


def _speeds(result: IdentificationResult) -> Html:
    pairs = zip(result.joints, result.processing.minimum_speed, strict=False)
    body = [
        tag(
            "tr",
            tag("th", joint, scope="row"),
            cell(with_unit(speed, speed_unit(result, index), 2)),
        )
        for index, (joint, speed) in enumerate(pairs)
    ]
    why = tag("small", " slower samples do not count: the sign of the speed is unsure there")
    caption = tag("caption", "Reversal speed", why)
    return tag("table", caption, tag("tbody", body), css="speeds")


def _dropped(result: IdentificationResult) -> Html:
    dropped: Counter[str] = Counter()
    for bag in result.bags:
        dropped.update(bag.dropped)
    total = result.fit.samples + sum(dropped.values())
    lines = [("used", result.fit.samples), *dropped.items()]
    body = [
        tag(
            "tr",
            tag("th", reason if reason == "used" else f"dropped: {reason}", scope="row"),
            cell(count(number_of)),
            cell(percent(100.0 * number_of / total if total else None, 3)),
        )
        for reason, number_of in lines
    ]
    body.append(
        tag("tr", tag("th", "all", scope="row"), cell(count(total)), cell(""), css="everything")
    )
    caption = tag("caption", "Decimated samples, summed over the joints")
    return tag("table", caption, tag("tbody", body), css="dropped")
