"""What the residual follows: speed, position, load, reversals; before and after."""

from idim_iv_ros.diagnosis.result import GapResult, GapSeries
from idim_iv_ros.report.figures import embed, legend
from idim_iv_ros.report.gap_words import (
    drawable,
    extended_beyond_refit,
    position_unit,
    rms,
    torque_unit,
)
from idim_iv_ros.report.markup import Html, section, tag
from idim_iv_ros.report.numerals import number
from idim_iv_ros.report.residual_curves import BACKWARD, FORWARD, Row, residual_figure

_FEW = 2


def residuals_section(result: GapResult) -> Html | None:
    """Return one figure for each joint; with many joints those without findings are folded."""
    drawn = drawable(result)
    if not drawn:
        return None
    opened = _worth_seeing(result)
    blocks = [
        _joint(result, series, index, series.joint in opened) for index, series in enumerate(drawn)
    ]
    return section(
        "What the residual follows",
        "residuals",
        tag(
            "p",
            "Measured torque less that of the model. The line is the smoothed mean of each "
            "direction, its band the 95 % interval of that mean; the dots are single samples. "
            "A good model leaves flat lines at zero. Over speed, a hook near zero is Stribeck "
            "friction or presliding, a bend at high speed nonlinear viscous friction; over "
            "position, equal curves of both directions are a torque (ripple, spring, gravity), "
            "opposite curves a friction; over load, lines that open like a butterfly are "
            "load-dependent friction; after a reversal, curves that start apart and settle are "
            "presliding or backlash.",
            css="explanation",
        ),
        legend(("line", FORWARD, "forwards (speed > 0)"), ("line", BACKWARD, "backwards")),
        blocks,
    )


def _worth_seeing(result: GapResult) -> set[str]:
    """Joints that are shown unfolded: all of few, those with causes, or the one that is worst."""
    if len(result.series) <= _FEW:
        return set(result.joints)
    joints = {each.joint for each in result.causes} | {each.other_joint for each in result.causes}
    if result.unexplained is not None:
        joints.add(result.unexplained.joint)
    named = {joint for joint in joints if joint is not None}
    worst = max(result.joint_gaps, key=lambda each: each.share, default=None)
    return named or ({worst.joint} if worst else set(result.joints[:1]))


def _joint(result: GapResult, series: GapSeries, index: int, opened: bool) -> Html:
    rows = _rows(result, series)
    unit = torque_unit(result, series.joint)
    drawing, height = residual_figure(series, rows, unit, position_unit(result, series.joint))
    sizes = ", ".join(f"{row.title} {number(rms(row.residual), 2)} {unit}" for row in rows)
    words = (
        f"Residual of {series.joint} over speed, position, load and distance since reversal: "
        + ", ".join(row.title for row in rows)
    )
    return tag(
        "details",
        tag("summary", tag("h3", series.joint, tag("small", f" residual, rms: {sizes}"))),
        embed(drawing, f"residual-{index}", height, words),
        css="plot",
        open=opened,
    )


def _rows(result: GapResult, series: GapSeries) -> list[Row]:
    rows = []
    # A refit hides what only the numbers of the nominal model have wrong.
    parametric = any(each.kind == "parametric" for each in result.causes)
    if series.given is not None and (parametric or not result.causes):
        rows.append(Row("given", series.torque - series.given, "given"))
    rows.append(Row("refit", series.torque - series.refit, "refit"))
    if extended_beyond_refit(series):
        rows.append(Row("extended", series.torque - series.extended, "refit"))
    return rows
