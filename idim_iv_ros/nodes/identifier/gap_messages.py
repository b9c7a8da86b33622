"""From gap.json to messages."""

from collections.abc import Sequence

from builtin_interfaces.msg import Time

from idim_iv_interfaces.msg import (
    GapAlternative,
    GapCause,
    GapChange,
    GapJoint,
    GapRegime,
    GapReport,
    GapStage,
    ParameterEstimate,
    UntestableEffect,
)
from idim_iv_ros.errors import DataError
from idim_iv_ros.files import GAP, REPORT
from idim_iv_ros.nodes.identifier.documents import Document, number

_NO_CHANGE: Document = {"before": None, "after": None, "shrinkage": None, "ci95": None}


def gap_message(document: Document, stamp: Time, bags: Sequence[str], folder: str) -> GapReport:
    """Return the diagnosis as a message.

    Parameters
    ----------
    document
        Content of gap.json.
    stamp
        When the diagnosis ended.
    bags
        Relative to the bag directory.
    folder
        Of the files, relative to the output directory.

    Raises
    ------
    DataError
        A key is missing or has another type.
    """
    try:
        return _report(document, stamp, bags, folder)
    except (KeyError, TypeError, AttributeError, AssertionError, ValueError) as error:
        raise DataError(f"{folder}/{GAP}: cannot be sent as a message: {error!r}") from error


def _report(document: Document, stamp: Time, bags: Sequence[str], folder: str) -> GapReport:
    where = document["where"]
    unexplained = document["unexplained"] or {}
    message = GapReport(
        robot=document["robot"],
        verdict=document["verdict"],
        summary=document["summary"],
        causes=[_cause(each) for each in document["causes"]],
        unexplained_joint=unexplained.get("joint") or "",
        unexplained_family=unexplained.get("family") or "",
        unexplained_share=number(unexplained.get("share")),
        unexplained_where=unexplained.get("where") or "",
        joints=[_joint(each) for each in where["joints"]],
        regimes=[_regime(each) for each in where["regimes"]],
        findings=document["findings"],
        not_testable=[_untestable(each) for each in document["not_testable"]],
        notes=document["notes"],
        without=document["without"],
        bags=list(bags),
        files=[f"{folder}/{name}" for name in (GAP, REPORT)],
        duration=sum(value or 0.0 for value in document["timing"].values()),
    )
    joints = [each.joint for each in message.joints]
    message.stages = [_stage(each, joints) for each in document["stages"]]
    message.header.stamp = stamp
    return message


def _cause(each: Document) -> GapCause:
    evidence = each["evidence"]
    return GapCause(
        effect=each["effect"],
        kind=each["kind"],
        joint=each["joint"] or "",
        other_joint=each["other_joint"] or "",
        parameters=[_parameter(name, value) for name, value in each["parameters"].items()],
        statistic=number(evidence["statistic"]),
        p_value=number(evidence["p_value"]),
        held_out_gain=number(evidence["held_out_gain"]),
        folds_positive=evidence["folds_positive"],
        indistinguishable_from=[_rival(rival) for rival in each["indistinguishable_from"]],
        torque_gap=_change(each["torque_gap"]),
        simulation_gap=_change(each["simulation_gap"] or _NO_CHANGE),
        sentence=each["sentence"],
    )


def _parameter(name: str, each: Document) -> ParameterEstimate:
    nothing = float("nan")
    return ParameterEstimate(
        name=name,
        unit=each["unit"],
        value=number(each["value"]),
        std=number(each["std"]),
        relative_std_percent=nothing,
        ls_value=nothing,
        given_value=nothing,
    )


def _rival(each: Document) -> GapAlternative:
    return GapAlternative(
        effect=each["effect"],
        joint=each["joint"] or "",
        correlation=number(each["correlation"]),
    )


def _change(each: Document) -> GapChange:
    low, high = _interval(each["ci95"])
    return GapChange(
        before=number(each["before"]),
        after=number(each["after"]),
        noise_floor=number(each.get("noise_floor")),
        shrinkage=number(each["shrinkage"]),
        shrinkage_low=low,
        shrinkage_high=high,
    )


def _joint(each: Document) -> GapJoint:
    return GapJoint(
        joint=each["joint"],
        rms=number(each["rms"]),
        relative_percent=number(each["relative_percent"]),
        share=number(each["share"]),
        noise_floor=number(each["noise_floor"]),
        floor_origin=each["floor_origin"],
    )


def _regime(each: Document) -> GapRegime:
    low, high = _interval(each["ci95"])
    numbers = ("low", "high", "energy_share", "occupancy", "lift")
    return GapRegime(
        joint=each["joint"],
        axis=each["axis"],
        unit=each["unit"],
        lift_low=low,
        lift_high=high,
        **{name: number(each[name]) for name in numbers},
    )


def _stage(each: Document, joints: Sequence[str]) -> GapStage:
    torque, tracking = each["torque_rms"], each["tracking_rms"] or {}
    intervals = [_interval(each["torque_ci95"].get(joint)) for joint in joints]
    return GapStage(
        stage=each["stage"],
        torque_rms=[number(torque.get(joint)) for joint in joints],
        torque_rms_low=[low for low, _ in intervals],
        torque_rms_high=[high for _, high in intervals],
        tracking_rms=[number(tracking.get(joint)) for joint in joints],
        note=each["note"],
    )


def _untestable(each: Document) -> UntestableEffect:
    return UntestableEffect(
        effect=each["effect"],
        joint=each["joint"] or "",
        reason=each["reason"],
        excitation_needed=each["excitation_needed"],
        smallest=each["smallest"],
    )


def _interval(ends: Sequence[float | None] | None) -> tuple[float, float]:
    low, high = ends or (None, None)
    return number(low), number(high)
