"""What this recording cannot show, and what it cannot tell apart."""

from idim_iv_ros.diagnosis.result import Confusability, GapResult
from idim_iv_ros.report.gap_words import effect_words, untestable
from idim_iv_ros.report.markup import Html, section, sentence, tag
from idim_iv_ros.report.numerals import fixed, known, percent

_ALIKE, _SAME = 0.8, 0.95
_NAMED = 4  # pairs in the heading of a matrix


def limits_section(result: GapResult) -> Html:
    """Return the effects that are not testable, and a matrix of look-pairs for each joint."""
    return section(
        "What this recording cannot tell",
        "limits",
        tag(
            "p",
            "From the motion alone, before the torque is looked at. An effect that is listed "
            "here is neither found nor excluded.",
            css="explanation",
        ),
        _not_testable(result),
        _matrices(result),
    )


def _not_testable(result: GapResult) -> Html:
    if not result.not_testable:
        return tag("p", "Every effect of the catalogue is testable at every joint.")
    rows = [
        tag(
            "tr",
            tag("th", effect_words(each.effect), scope="row"),
            tag("td", each.joints or "all"),
            tag("td", sentence(each.reason, result.joints), css="words"),
            tag("td", each.smallest or "at no size"),
            tag("td", sentence(each.excitation_needed, result.joints), css="words"),
        )
        for each in untestable(result)
    ]
    heads = ("Effect", "Joint", "Why not", "Seen from", "Record this next")
    head = tag("tr", [tag("th", text, scope="col") for text in heads])
    table = tag("table", tag("thead", head), tag("tbody", rows), css="untestable")
    return tag("div", table, css="wide")


def _matrices(result: GapResult) -> Html | None:
    if not result.confusability:
        return None
    few = len(result.confusability) <= 2
    named = {each.joint for each in result.causes}
    return tag(
        "div",
        tag("h3", "Effects that look alike"),
        tag(
            "p",
            "Largest canonical correlation of the torques that two effects would add, less what "
            "the refitted model absorbs, over all their shapes: 0 is easily told apart; from 0.95 "
            "(bold) there are shapes of both that this recording cannot tell apart. What was "
            "found may still be told from its look-pairs by its own shape; its card above says "
            "so. Absorbed: share of the effect that the refit takes for something else. "
            "Smallest: the size from which it would be seen.",
            css="explanation",
        ),
        [_matrix(each, few or each.joint in named) for each in result.confusability],
    )


def _matrix(each: Confusability, opened: bool) -> Html:
    heads = [tag("th", str(k + 1), scope="col", css="num") for k in range(len(each.effects))]
    rows = [
        tag(
            "tr",
            tag("th", f"{k + 1}  {effect_words(effect)}", scope="row"),
            [_cell(float(each.correlation[k, i]), i == k) for i in range(len(each.effects))],
            tag("td", percent(100.0 * float(each.absorbed[k])), css="num"),
            tag("td", each.smallest[k], css="smallest"),
        )
        for k, effect in enumerate(each.effects)
    ]
    ends = [
        tag("th", "Absorbed", scope="col", css="num"),
        tag("th", "Smallest", scope="col"),
    ]
    head = tag("tr", tag("th", "Effect", scope="col"), heads, ends)
    table = tag("table", tag("thead", head), tag("tbody", rows), css="alike")
    return tag(
        "details",
        tag("summary", tag("h3", each.joint, tag("small", f" {_pairs(each)}"))),
        tag("div", table, css="wide"),
        open=opened,
    )


def _pairs(each: Confusability) -> str:
    same = [
        f"{effect_words(first)} and {effect_words(each.effects[i])}"
        for k, first in enumerate(each.effects)
        for i in range(k + 1, len(each.effects))
        if float(each.correlation[k, i]) >= _SAME
    ]
    if not same:
        return "no pair of effects looks alike"
    more = f" and {len(same) - _NAMED} more pairs" if len(same) > _NAMED else ""
    return f"may look alike: {', '.join(same[:_NAMED])}{more}"


def _cell(correlation: float, own: bool) -> Html:
    if own or not known(correlation):
        return tag("td", "", css="own" if own else None)
    alpha = max(0.0, correlation - 0.3) / 0.7 * 0.75
    text = fixed(correlation, 2) if correlation >= 0.005 else "0"
    return tag(
        "td",
        tag("b", text) if correlation >= _SAME else text,
        css="num" if correlation >= _ALIKE else "num quiet",
        style=f"background:rgba(213,94,0,{alpha:.2f})",
    )
