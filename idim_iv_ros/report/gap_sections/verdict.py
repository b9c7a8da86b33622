"""What is the gap, in one paragraph: the first thing that a reader sees."""

from idim_iv_ros.diagnosis.result import GapResult, JointGap
from idim_iv_ros.report.gap_words import VERDICTS, duration, effect_at, torque_unit
from idim_iv_ros.report.markup import Html, bullets, join, key_numbers, tag
from idim_iv_ros.report.numerals import THIN, cell, known, number, percent, with_unit

_NAMED = 4  # causes in a tile


def verdict_section(result: GapResult) -> Html:
    """Return the verdict paragraph, the key numbers, and the gap joint by joint."""
    colour, sign, words = VERDICTS[result.verdict]
    badge = tag("span", tag("b", sign, aria_hidden="true"), words, css=f"badge {colour}")
    return tag(
        "section",
        tag("div", badge, tag("p", result.summary, css="headline"), css=f"verdict {colour}"),
        _tiles(result),
        _joints(result),
        id="verdict",
    )


def _tiles(result: GapResult) -> Html:
    worst = max(result.joint_gaps, key=lambda each: each.share, default=None)
    numbers = [
        ("Causes accepted", str(len(result.causes)), _names(result)),
        _worst(worst),
        _relative(worst),
        _reached(result, worst),
        ("Recorded", with_unit(duration(result), "s"), _bags(result)),
        ("Not testable", str(len(result.not_testable)), "effects that this recording cannot show"),
    ]
    return key_numbers(numbers)


def _names(result: GapResult) -> str:
    names = ", ".join(effect_at(each.effect, each.joint) for each in result.causes[:_NAMED])
    if len(result.causes) > _NAMED:
        names += f" and {len(result.causes) - _NAMED} more"
    return names or "nothing of the catalogue helps on held-out data"


def _worst(worst: JointGap | None) -> tuple[str, str, str]:
    if worst is None:
        return ("Largest gap", "–", "no joint could be judged")
    return (
        "Largest gap",
        worst.joint,
        f"{percent(100.0 * worst.share)} of the gap of all joints, each by its torque",
    )


def _relative(worst: JointGap | None) -> tuple[str, str, str]:
    if worst is None:
        return ("Gap there", "–", "")
    return ("Gap there", percent(worst.relative_percent), "of the measured torque")


def _reached(result: GapResult, worst: JointGap | None) -> tuple[str, str, str]:
    name = "After diagnosis"
    if worst is None or len(result.stages) < 2:
        return (name, "–", "no model beyond the first one")
    last = result.stages[-1].torque_rms.get(worst.joint)
    first = result.stages[0].torque_rms.get(worst.joint)
    unit = torque_unit(result, worst.joint)
    before = "nominal model" if result.stages[0].name == "given" else "first model"
    note = f"torque gap there; {before}: {with_unit(first, unit, 2)}"
    return (name, with_unit(last, unit, 2), note)


def _bags(result: GapResult) -> str:
    return f"{len(result.bags)} recording{'s' if len(result.bags) != 1 else ''}"


def _joints(result: GapResult) -> Html | None:
    if not result.joint_gaps:
        return None
    rows = []
    for each in result.joint_gaps:
        unit = torque_unit(result, each.joint)
        rows.append(
            tag(
                "tr",
                tag("th", each.joint, scope="row"),
                tag("td", _bar(100.0 * each.share), css="bar"),
                cell(percent(100.0 * each.share)),
                cell(with_unit(each.rms, unit)),
                cell(percent(each.relative_percent)),
                cell(with_unit(each.noise_floor, unit)),
                tag("td", each.floor_origin, css="words"),
            )
        )
    heads = (
        ("Joint", None),
        ("Share of the gap", "bar"),
        ("", "num"),
        ("Gap, rms", "num"),
        ("of the torque", "num"),
        ("Noise floor", "num"),
        ("Known from", None),
    )
    head = tag("tr", [tag("th", text, scope="col", css=css) for text, css in heads])
    table = tag("table", tag("thead", head), tag("tbody", rows), css="gap-joints")
    model = "nominal model" if any(each.name == "given" for each in result.stages) else "refit"
    return join(
        tag(
            "h3",
            "Where the gap lies",
            tag("small", f" of the {model}, all samples; shares: each joint by its own torque"),
        ),
        bullets(result.findings),
        tag("div", table, css="wide"),
    )


def _bar(share: float) -> Html:
    width = number(min(max(share, 0.0), 100.0), 3) if known(share) else "0"
    return tag("i", css="bar-share", style=f"width:{width.replace(THIN, '')}%")
