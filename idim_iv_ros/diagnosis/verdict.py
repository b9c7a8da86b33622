"""The verdict in one word and in one paragraph."""

from collections.abc import Sequence

from idim_iv_ros.diagnosis.result import Cause, JointGap, Unexplained, Verdict


def verdict_of(
    causes: Sequence[Cause],
    rest: Unexplained | None,
    *,
    parameters: bool = False,
    unexplained: bool = False,
) -> Verdict:
    """One word: named causes count before what has no name.

    Parameters
    ----------
    parameters
        Whether new parameters take a part of the gap that no cause names: that they are in error is
        known, which of them is not.
    unexplained
        Whether much of the gap stays.
    """
    kinds: set[str] = {cause.kind for cause in causes}
    if parameters and not kinds and not unexplained:
        kinds = {"parametric"}
    if kinds == {"parametric", "structural"}:
        return "both"
    if "parametric" in kinds:
        return "parametric" if rest is None else "unknown"
    if "structural" in kinds:
        return "structural"
    return "unknown" if unexplained or rest is not None else "none"


def summary_of(
    verdict: Verdict,
    causes: Sequence[Cause],
    rest: Unexplained | None,
    gaps: Sequence[JointGap],
    without: Sequence[str],
    left: str = "",
    *,
    numbers: str = "",
    more: int = 0,
    model: str = "nominal model",
) -> str:
    """One paragraph that a robot engineer can act on.

    Parameters
    ----------
    causes
        Those to be told.
    left
        What the last model still misses, in words.
    numbers
        Wrong given numbers that no cause tells, in words.
    more
        How many smaller causes there are.
    model
        Whose gaps they are, in words.
    """
    sentences = []
    worst = max(gaps, key=lambda gap: gap.share, default=None)
    if worst is not None and worst.relative_percent is not None:
        sentences.append(
            f"The {model} misses {worst.relative_percent:.3g} % of the torque at "
            f"{worst.joint}, where the gap is widest."
        )
    if verdict == "none":
        sentences.append(
            "No effect of the catalogue explains more of it than chance: what is left is noise, or "
            "too small for these recordings to show."
        )
    for cause in causes:
        sentences.append(cause.sentence[0].upper() + cause.sentence[1:] + ".")
    if more:
        others = "1 smaller cause is" if more == 1 else f"{more} smaller causes are"
        sentences.append(f"{others} listed beside these.")
    if numbers:
        sentences.append(numbers)
    if rest is not None:
        sentences.append(
            f"Not in the catalogue: {rest.where}"
            + (
                "."
                if rest.family == "event"  # said in `where`
                else f"; it holds {100 * rest.share:.0f} % of what the refit leaves there."
            )
        )
    if left:
        sentences.append(left)
    if without:
        sentences.append(f"Left out of the catalogue on request: {', '.join(without)}.")
    return " ".join(sentences)
