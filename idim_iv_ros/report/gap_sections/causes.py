"""Each accepted cause: what, how large, why it is believed, what it may be mistaken for."""

from idim_iv_ros.diagnosis.parameter_words import parameter_words
from idim_iv_ros.diagnosis.result import Cause, Gap, GapResult, Unexplained
from idim_iv_ros.excitation.segments import separating_motion
from idim_iv_ros.report.gap_sections.parameters import parameter_table
from idim_iv_ros.report.gap_words import effect_at, effect_words, small_unit, torque_unit
from idim_iv_ros.report.markup import Html, bullets, join, section, sentence, tag
from idim_iv_ros.report.numerals import (
    cell,
    known,
    number,
    p_value,
    percent,
    with_unit,
)
from idim_iv_ros.report.tracking_change import tracking_change


def causes_section(result: GapResult) -> Html:
    """Return one card for each cause, and what no cause explains."""
    cards = [_card(result, cause, place + 1) for place, cause in enumerate(result.causes)]
    if result.unexplained is not None:
        cards.append(_unexplained(result.unexplained))
    if not cards:
        cards.append(
            tag(
                "p",
                "No effect of the catalogue is accepted: none helps on data that was held out by "
                "more than chance would. What this recording cannot show is listed below.",
            )
        )
    left_out = ", ".join(effect_words(each) for each in result.without)
    return section(
        "What causes it",
        "causes",
        tag("p", f"Left out of the catalogue on request: {left_out}.", css="warning")
        if left_out
        else None,
        cards,
        _parameter_errors(result),
    )


def _parameter_errors(result: GapResult) -> Html | None:
    """Return the parameter errors joint by joint, and what no listed cause accounts for."""
    if not result.parameter_errors:
        return None
    rows = []
    for each in result.parameter_errors:
        unit = torque_unit(result, each.joint)
        values = (each.given, each.named, each.refit, each.remaining)
        rows.append(
            tag(
                "tr",
                tag("th", each.joint, scope="row"),
                [cell(with_unit(value, unit)) for value in values],
                cell(percent(100.0 * each.share_of_torque)),
            )
        )
    heads = (
        ("Joint", None),
        ("Nominal model", "num"),
        ("With the parametric causes", "num"),
        ("With new base parameters", "num"),
        ("Remaining parameter error", "num"),
        ("of the torque", "num"),
    )
    head = tag("tr", [tag("th", text, scope="col", css=css) for text, css in heads])
    return join(
        tag("h3", "Parameter errors joint by joint", tag("small", " torque gap, rms, all samples")),
        tag("div", tag("table", tag("thead", head), tag("tbody", rows)), css="wide"),
    )


def _card(result: GapResult, cause: Cause, rank: int) -> Html:
    kind = "structural" if cause.kind == "structural" else "parametric"
    badge = tag("span", kind, css=f"badge {'bad' if kind == 'structural' else 'fair'}")
    title = effect_at(cause.effect, cause.joint, cause.other_joint)
    return tag(
        "article",
        tag("h3", f"{rank}. {title[:1].upper()}{title[1:]} ", badge),
        tag("p", sentence(cause.sentence, result.joints)),
        tag(
            "div",
            tag("div", _parameters(cause), _evidence(cause)),
            tag("div", _gaps(result, cause), _rivals(cause)),
            css="grid pair",
        ),
        css="cause",
    )


def _parameters(cause: Cause) -> Html | None:
    if not cause.parameters:
        return None
    named = {parameter_words(cause.effect, name): each for name, each in cause.parameters.items()}
    unsure = any(each.std is None for each in cause.parameters.values())
    return join(
        parameter_table(named),
        tag("p", tag("small", "Without ±: chosen among a few, not fitted, or not known how well."))
        if unsure
        else None,
    )


def _evidence(cause: Cause) -> Html:
    evidence = cause.evidence
    name = "2 log likelihood ratio" if cause.kind == "structural" else "Wald statistic"
    facts = [
        (name, number(evidence.statistic)),
        ("p-value, all candidates counted", p_value(evidence.p_value)),
    ]
    if evidence.held_out_gain is not None:  # wrong numbers and control laws need no blocks
        gain = percent(100.0 * evidence.held_out_gain)
        facts.append(("Residual energy that goes on held-out blocks", gain))
    if evidence.folds_positive:
        facts.append(("Held-out blocks on which it helps", evidence.folds_positive))
    rows = [tag("tr", tag("th", what, scope="row"), cell(value)) for what, value in facts]
    return tag("table", tag("tbody", rows), css="facts")


def _gaps(result: GapResult, cause: Cause) -> Html:
    place = cause.joint or "all joints"
    unit = torque_unit(result, cause.joint)
    rows = [_gap(f"Torque gap, {place}", cause.torque_gap, 1.0, unit)]
    rows += _joint_changes(result, cause)
    tracking = tracking_change(result, cause)
    if tracking.gap is not None:
        small = small_unit(result, cause.joint)
        title = f"Tracking error, {place}"
        rows.append(_gap(title, tracking.gap, 1e3, small, tracking.words))
    else:
        rows.append(tag("p", tag("small", sentence(f"Tracking error: {tracking.words}"))))
    return join(rows)


def _joint_changes(result: GapResult, cause: Cause) -> list[Html]:
    """What the cause takes of the gap at each joint, as a share of the joint's torque."""
    if not cause.joint_gaps:
        return []
    items = []
    for each in cause.joint_gaps:
        unit = torque_unit(result, each.joint)
        before, after = (with_unit(value, unit) for value in (each.before, each.after))
        share = percent(100.0 * each.share_of_torque)
        items.append(f"{each.joint}: {before} → {after}, {share} of its torque")
    return [bullets(items)]


def _gap(title: str, gap: Gap, factor: float, unit: str, which: str = "") -> Html:
    before, after = (with_unit(factor * each, unit) for each in (gap.before, gap.after))
    return tag(
        "div",
        tag("p", tag("b", title), f": {before} → {after}"),
        _meter(gap),
        tag("p", tag("small", "; ".join(filter(None, (_shrinkage(gap), which))))),
        css="shrinkage",
    )


def _shrinkage(gap: Gap) -> str:
    if gap.shrinkage is None or not known(gap.shrinkage):
        return "shrinkage cannot be told"
    interval = ""
    if gap.ci95 is not None and known(gap.ci95[0]) and known(gap.ci95[1]):
        low, high = (number(100.0 * each, 2) for each in gap.ci95)
        interval = f" ({low} to {high} %)"
    of = "of what lies above the noise floor" if gap.noise_floor is not None else "of it"
    return f"{percent(100.0 * gap.shrinkage)}{interval} {of} goes"


def _meter(gap: Gap) -> Html | None:
    if gap.shrinkage is None or not known(gap.shrinkage):
        return None
    share = min(max(gap.shrinkage, 0.0), 1.0)
    parts = [tag("i", css="full effect", style=f"left:0;width:{100.0 * share:.1f}%")]
    if gap.ci95 is not None and known(gap.ci95[0]) and known(gap.ci95[1]):
        low, high = (min(max(each, 0.0), 1.0) for each in gap.ci95)
        width = 100.0 * (high - low)
        parts.append(tag("i", css="whisker", style=f"left:{100.0 * low:.1f}%;width:{width:.1f}%"))
    return tag("div", parts, css="track meter")


def _rivals(cause: Cause) -> Html:
    if not cause.indistinguishable_from:
        return tag("p", tag("b", "Told apart"), " from every other effect that is testable here.")
    items = []
    for rival in cause.indistinguishable_from:
        motion = separating_motion(cause.effect, rival.effect)
        items.append(
            tag(
                "li",
                tag("b", effect_at(rival.effect, rival.joint)),
                f" (correlation {number(rival.correlation, 3)}). ",
                sentence(f"To separate them: {motion}") if motion else None,
            )
        )
    return tag(
        "div",
        tag("p", tag("b", "Cannot be told from"), ", on this recording:"),
        tag("ul", items),
        css="warning",
    )


def _unexplained(unexplained: Unexplained) -> Html:
    return tag(
        "article",
        tag("h3", f"Not in the catalogue, at {unexplained.joint} ", _open_badge("unknown")),
        tag(
            "p",
            f"{percent(100.0 * unexplained.share)} of the whitened residual's energy "
            f"at {unexplained.joint} {_FAMILIES[unexplained.family]} in a way that no effect of "
            f"the catalogue has: {unexplained.where}.",
        ),
        css="cause",
    )


_FAMILIES = {
    "velocity": "follows the speed",
    "position": "follows the position",
    "load": "follows the load",
    "time": "follows the time",
    "frequency": "follows the frequency",
    "event": "comes in single events,",
}


def _open_badge(words: str) -> Html:
    return tag("span", words, css="badge open")
