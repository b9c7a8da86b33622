"""Coloured words: the word says it, the colour only helps."""

from idim_iv_ros.report.markup import Html, tag

_VERDICTS = {
    "valid": ("good", "✓"),
    "autocorrelated": ("fair", "≈"),
    "misspecified": ("bad", "✕"),
    "inconclusive": ("open", "?"),
}


def verdict_colour(verdict: str) -> str:
    """Return the CSS class of a verdict."""
    return _VERDICTS.get(verdict, ("open", "?"))[0]


def verdict_badge(verdict: str) -> Html:
    """Return the verdict on a joint as a badge."""
    colour, sign = _VERDICTS.get(verdict, ("open", "?"))
    return _badge(colour, sign, verdict)


def outcome_badge(accepted: bool | None, *, neutral: bool = False) -> Html:
    """Return the outcome of a test as a badge; `neutral` where neither outcome is bad news."""
    if accepted is None:
        return _badge("open", "–", "not tested")
    if neutral:
        return _badge("fair", "=" if accepted else "≠", "accepted" if accepted else "rejected")
    return _badge("good", "✓", "accepted") if accepted else _badge("bad", "✕", "rejected")


def _badge(colour: str, sign: str, words: str) -> Html:
    return tag("span", tag("b", sign, aria_hidden="true"), words, css=f"badge {colour}")
