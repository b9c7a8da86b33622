"""May the result be believed? The first thing that a reader sees."""

from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.report.badges import verdict_badge, verdict_colour
from idim_iv_ros.report.markup import Html, join, key_numbers, sentence, tag
from idim_iv_ros.report.numerals import cell, count, exact, number, percent, with_unit
from idim_iv_ros.report.units import torque_unit


def verdict_section(result: IdentificationResult) -> Html:
    """Return the verdict in one sentence, joint by joint, and the key numbers."""
    verdict = result.verdict
    return tag(
        "section",
        tag(
            "div",
            verdict_badge(verdict.verdict),
            tag("p", verdict.sentence, css="headline"),
            css=f"verdict {verdict_colour(verdict.verdict)}",
        ),
        _key_numbers(result),
        _joints(result),
        id="verdict",
    )


def _key_numbers(result: IdentificationResult) -> Html:
    fit = result.fit
    ls_error = f"IDIM-LS: {percent(fit.ls_relative_error_percent, 3)}"
    if result.estimator == "idim-ls":
        ls_error = "of the measured torque"
    seconds = sum(bag.duration for bag in result.bags)
    rates = sorted({bag.rate for bag in result.bags})
    bags = f"{len(result.bags)} recording{'s' if len(result.bags) != 1 else ''}"
    recorded = f"{bags}, {' and '.join(exact(rate, 'Hz') for rate in rates)}"
    row_rate = exact(round(result.processing.row_rate, 2), "Hz")
    numbers = [
        ("Relative error", percent(fit.relative_error_percent, 3), ls_error),
        (
            "Parameters",
            f"{fit.essential_parameters} of {fit.base_parameters}",
            "base parameters are essential",
        ),
        _iterations(result),
        ("Recorded", with_unit(seconds, "s", 3), recorded),
        (
            "Used",
            count(fit.samples),
            f"samples of all joints, decimated to {row_rate}",
        ),
        ("Condition number", number(fit.condition_number, 3), "of the observation matrix"),
    ]
    return join(
        key_numbers(numbers),
        tag("p", tag("b", "Instruments: "), result.instruments.source, "."),
    )


def _iterations(result: IdentificationResult) -> tuple[str, str, str]:
    if result.estimator == "idim-ls":
        return ("Estimator", "IDIM-LS", result.convergence_note)
    state = "" if result.converged else "NOT converged: "
    note = result.convergence_note.removeprefix("not converged: ")
    return ("Iterations", str(result.iterations), f"{state or 'converged: '}{note}")


def _joints(result: IdentificationResult) -> Html:
    rows = []
    for index, residual in enumerate(result.residuals):
        words = residual.sentence.removeprefix(f"{residual.joint}: ")
        rows.append(
            tag(
                "tr",
                tag("th", residual.joint, scope="row"),
                tag("td", verdict_badge(residual.verdict)),
                tag("td", sentence(words), css="words"),
                cell(percent(residual.relative_percent)),
                cell(with_unit(residual.rms, torque_unit(result, index), 2)),
            )
        )
    heads = ("Joint", "Verdict", "What it means", "Residual, % of torque", "Residual, rms")
    return tag(
        "table",
        tag("thead", tag("tr", [_head(text) for text in heads])),
        tag("tbody", rows),
        css="joints",
    )


def _head(text: str) -> Html:
    return tag("th", text, scope="col", css="num" if text.startswith("Residual") else None)
