"""What is left of the torque: is it noise? Autocorrelation, distribution, words."""

import numpy as np

from idim_iv_ros.identification.result import IdentificationResult, JointResidual
from idim_iv_ros.report.figures import BLUE, INK, ORANGE, SHADE, embed, legend
from idim_iv_ros.report.markup import Html, section, tag
from idim_iv_ros.report.numerals import cell, number, p_value, percent, with_unit
from idim_iv_ros.report.sections.residual_plots import acf_figure, histogram_figure
from idim_iv_ros.report.series import contiguous_runs
from idim_iv_ros.report.session_axis import axis_of_identification
from idim_iv_ros.report.units import torque_unit
from idim_iv_ros.statistics import HypothesisTest

_HEIGHT = 230
_SPACE = "\N{NO-BREAK SPACE}"


def residuals_section(result: IdentificationResult) -> Html:
    """Return the residual analysis of each joint (paper, section IV)."""
    return section(
        "Residuals",
        "residuals",
        tag(
            "p",
            "If the model is right, the residual is noise. A white residual (no correlation "
            "between one sample and the next) lets the usual standard deviations stand. A coloured "
            "one means, where the instruments are valid, that the data are sampled faster than "
            "the control loop moves: samples repeat each other, and standard deviations that "
            "count them all are too small. An autoregressive filter, its order chosen by AIC, "
            "makes the residual white. The distribution matters less: it is shown so that "
            "outliers and asymmetry can be seen.",
            css="explanation",
        ),
        _table(result),
        legend(
            ("line", ORANGE, "residual as it is"),
            ("bar", BLUE, "whitened by the autoregressive filter"),
            ("band", SHADE, "95 % of a white residual's correlations"),
            ("line", INK, "Gaussian"),
        ),
        [_plots(result, index) for index in range(len(result.residuals))],
    )


def _table(result: IdentificationResult) -> Html:
    heads = (
        ("Joint", False),
        ("Rms", True),
        ("% of torque", True),
        ("AR order", True),
        ("Predicted by its past", True),
        ("White-noise σ too small by", True),
        ("White?", False),
        ("White after filtering?", False),
        ("Gaussian after filtering?", False),
    )
    rows = [
        tag(
            "tr",
            tag("th", residual.joint, scope="row"),
            cell(with_unit(residual.rms, torque_unit(result, index), 2)),
            cell(percent(residual.relative_percent)),
            cell(residual.ar_order),
            cell(percent(100.0 * residual.predictable_share)),
            cell(f"{number(residual.sigma_understatement, 2)} ×"),
            tag("td", _white_words(residual)),
            tag("td", _whitened_words(residual)),
            tag("td", _gaussian_words(residual)),
        )
        for index, residual in enumerate(result.residuals)
    ]
    head = [tag("th", text, scope="col", css="num" if num else None) for text, num in heads]
    table = tag("table", tag("thead", tag("tr", head)), tag("tbody", rows), css="residuals")
    return tag("div", table, css="wide")


def _white_words(residual: JointResidual) -> Html:
    if residual.white is None:
        return _words("not tested", residual.whiteness.reason or "")
    test = residual.whiteness
    if not residual.white:
        return _words("no", _p(test))
    return _words("yes" if test.accepted else "yes, what colour there is harms nothing", _p(test))


def _whitened_words(residual: JointResidual) -> Html:
    test = residual.whiteness_after
    if residual.ar_order == 0:
        return _words("nothing to filter", "")
    if test.accepted is None:
        return _words("not tested", test.reason or "")
    if test.accepted:
        return _words("yes", _p(test))
    left = number(residual.largest_correlation_after, 2)
    return _words("not fully", f"{_p(test)}, largest correlation {left}")


def _gaussian_words(residual: JointResidual) -> Html:
    test = residual.normality
    if test.accepted is None:
        return _words("not tested", test.reason or "")
    skewness, kurtosis = residual.skewness, residual.excess_kurtosis
    shape = f"skewness {number(skewness, 2)}, excess kurtosis {number(kurtosis, 2)}"
    if test.accepted:
        return _words("yes", f"{_p(test)}; {shape}")
    near = abs(skewness) < 0.5 and abs(kurtosis) < 1.0
    return _words("nearly" if near else "no", f"{_p(test)}; {shape}")


def _p(test: HypothesisTest) -> str:
    text = p_value(test.p_value)
    return f"p{_SPACE}{text}" if text.startswith("<") else f"p{_SPACE}={_SPACE}{text}"


def _words(answer: str, detail: str) -> Html:
    return tag("span", answer, tag("small", f" ({detail})") if detail else None)


def _plots(result: IdentificationResult, index: int) -> Html:
    residual, series = result.residuals[index], result.series[index]
    raw = np.asarray(series.measured) - np.asarray(series.predicted)
    runs = contiguous_runs(series, axis_of_identification(result))
    whitening = residual.autoregression
    whitened = whitening.whiten(raw, runs) if whitening is not None and runs else raw
    joint = residual.joint
    rate = result.processing.row_rate
    return tag(
        "div",
        tag("h3", joint, tag("small", _caption(residual))),
        tag(
            "div",
            embed(
                acf_figure(residual, rate),
                f"acf-{index}",
                _HEIGHT,
                f"Autocorrelation of the residual of {joint}",
            ),
            embed(
                histogram_figure(raw, whitened),
                f"histogram-{index}",
                _HEIGHT,
                f"Histogram of the residual of {joint} with a Gaussian",
            ),
            css="grid pair",
        ),
        css="plot",
    )


def _caption(residual: JointResidual) -> str:
    if residual.white is None:
        colour = "colour not tested"
    elif residual.white:
        colour = "may be treated as white"
    else:
        colour = f"coloured, AR({residual.ar_order})"
    return f" {colour}"
