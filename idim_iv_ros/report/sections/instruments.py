"""The tests of instruments, specification and exogeneity, with what they mean in plain words."""

from collections.abc import Sequence

from idim_iv_ros.identification.result import IdentificationResult, InstrumentReport
from idim_iv_ros.report.badges import outcome_badge
from idim_iv_ros.report.markup import Html, bullets, section, sentence, tag
from idim_iv_ros.report.numerals import cell, count, exact, number, p_value, percent
from idim_iv_ros.statistics import HypothesisTest

_VALID = (
    "Instruments are what the motion would be without noise: a simulation of the same loop at "
    "the estimated parameters. H0 says that they are valid (Π = I): the observation matrix of "
    "the measured motion is that of the simulated motion plus noise. Accepted: simulated and "
    "measured motion differ by nothing but noise, and the estimates are consistent. Rejected: "
    "they differ systematically; the model or the control law is wrong at that joint and the "
    "estimates of its parameters are biased. A long recording rejects even a harmless deviation, "
    "so read the effect beside the p-value: how much of the torque it moves."
)
_SPECIFIED = (
    "A stiff loop holds the motion to its reference whatever the model is; a model error then "
    "shows in the torque alone. H0 says that nothing of the motion is left in the residual: it is "
    "unrelated to functions of the simulated position, speed and acceleration that the model does "
    "not hold. Rejected: an effect is missing that depends on what is named, of about the size "
    "given; below 2 % of the torque it is not held against the model, for what the filters smear "
    "around a reversal reaches that. Accepted: no such effect is seen above the noise; what "
    "depends on time, frequency or events is not looked for here."
)
_EXOGENOUS = (
    "H0 says that the measured motion is unrelated to the torque noise (exogenous, γ = 0). "
    "Accepted: least squares does as well as instrumental variables on this recording. Rejected: "
    "noise feeds back through the control loop into the measured motion; IDIM-LS is biased and "
    "the instrumental variables are needed. Neither outcome speaks against the model, and both "
    "mean something only where the instruments are valid."
)


def instruments_section(result: IdentificationResult) -> Html:
    """Return the tests for all rows and joint by joint."""
    report = result.instruments
    return section(
        "Instrument tests",
        "instruments",
        _source(report),
        tag("h3", "Are the instruments valid? Revised Durbin-Wu-Hausman test"),
        tag("p", _VALID, css="explanation"),
        _table(report.tests, effects=2),
        tag("h3", "Is anything of the motion left in the residual? Specification test"),
        tag("p", _SPECIFIED, css="explanation"),
        _table(result.specification.tests, effects=1),
        tag("h3", "Would least squares do? Exogeneity test"),
        tag("p", _EXOGENOUS, css="explanation"),
        _table(result.exogeneity.tests, effects=0),
        tag(
            "p",
            f"A right model is rejected anywhere with a probability of at most "
            f"{exact(100.0 * report.alpha, '%')}: half of it goes to the test of all rows, half is "
            "shared among the joints. The tests of the specification share a tenth of it, because "
            "the colour of the residual is estimated with them. The rows of each test are whitened "
            "by an autoregressive model of their own. F(a, b) has a and b degrees of freedom.",
            css="explanation",
        ),
    )


def _source(report: InstrumentReport) -> Html:
    failures = [f"Tried before and failed: {failure}" for failure in report.failures]
    return tag(
        "div",
        tag("p", tag("b", "Source of the instruments: "), report.source, "."),
        bullets(sentence(text) for text in [*failures, *report.notes]),
    )


def _table(tests: Sequence[HypothesisTest], *, effects: int) -> Html:
    """`effects`: how many effect sizes are shown, none, that on the torque, or both."""
    reasons = {test.reason for test in tests}
    if len(reasons) == 1 and all(test.accepted is None for test in tests):
        return tag("p", outcome_badge(None), f" because {reasons.pop()}.")
    heads = [("Rows", None), ("H0", None), ("Statistic", "num"), ("p", "num")]
    heads += [("Effect, % of torque", "num"), ("Largest |Π̂ − I|", "num")][:effects]
    head = [tag("th", text, scope="col", css=css) for text, css in heads]
    rows = [_row(test, effects=effects) for test in tests]
    return tag("table", tag("thead", tag("tr", head)), tag("tbody", rows), css="tests")


def _row(test: HypothesisTest, *, effects: int) -> Html:
    everything = test.scope == "all"
    name = tag("th", "all joints" if everything else test.scope, scope="row")
    outcome = tag("td", outcome_badge(test.accepted, neutral=effects == 0))
    css = "everything" if everything else None
    if test.accepted is None:
        span = str(2 + effects)
        reason = tag("td", f"because {test.reason}", colspan=span, css="words")
        return tag("tr", name, outcome, reason, css=css)
    cells = [cell(_statistic(test)), cell(p_value(test.p_value))]
    sizes = [percent(test.torque_deviation_percent), number(test.max_deviation, 2)]
    cells += [cell(size) for size in sizes[:effects]]
    return tag("tr", name, outcome, cells, css=css)


def _statistic(test: HypothesisTest) -> str:
    df = count(test.df or 0)
    law = f"χ²({df})" if test.df_denom is None else f"F({df}, {count(test.df_denom)})"
    return f"{law} = {number(test.statistic, 3)}"
