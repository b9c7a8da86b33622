"""Results as messages: a field of a message has the name of the attribute that fills it."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from builtin_interfaces.msg import Time

from idim_iv_interfaces import msg
from idim_iv_ros.diagnosis.result import (
    Cause,
    EffectParameter,
    GapResult,
    Hint,
    SignalChain,
    Stage,
)
from idim_iv_ros.files import GAP, REPORT, RESULT
from idim_iv_ros.identification.result import IdentificationResult, JointResidual
from idim_iv_ros.statistics import HypothesisTest

M = TypeVar("M")
_PACKAGE = "idim_iv_interfaces/"


def gap_message(result: GapResult, stamp: Time, bags: Sequence[str], folder: str) -> msg.GapReport:
    """Return a diagnosis as a message.

    Parameters
    ----------
    result
    stamp
        When the diagnosis ended.
    bags
        Relative to the bag directory.
    folder
        Of the files, relative to the output directory.
    """
    joints = [joint_gap.joint for joint_gap in result.joint_gaps]
    message = _message(
        msg.GapReport,
        result,
        **{
            f"unexplained_{name}": getattr(result.unexplained, name, None)
            for name in ("joint", "family", "share", "where")
        },
        joints=result.joint_gaps,
        stages=(),
        bags=bags,
        files=[f"{folder}/{name}" for name in (GAP, REPORT)],
        duration=sum(result.timing.values()),
    )
    message.stages = [
        _message(msg.GapStage, stage, **_in_order(stage, joints)) for stage in result.stages
    ]
    message.header.stamp = stamp
    return message


def result_message(
    result: IdentificationResult, stamp: Time, bags: Sequence[str], folder: str
) -> msg.IdentificationResult:
    """Return an identification as a message; parameters as of `gap_message`."""
    message = _message(
        msg.IdentificationResult,
        result,
        parameters=None,
        instruments=result.instruments.tests,
        instruments_source=result.instruments.source,
        specification=result.specification.tests,
        exogeneity=result.exogeneity.tests,
        verdict=result.verdict.sentence,
        relative_error_percent=result.fit.relative_error_percent,
        condition_number=result.fit.condition_number,
        samples=result.fit.samples,
        refined=result.refined is not None,
        refined_estimates=(),
        moved=() if result.refined is None else result.refined.moved,
        duration=sum(result.timing.values()),
        files=[f"{folder}/{name}" for name in (RESULT, REPORT)],
    )
    message.parameters = _message(
        msg.ParameterEstimates,
        result,
        iterations=0 if result.estimator == "idim-ls" else result.iterations,
        estimates=result.parameters,
        covariance=result.covariance.ravel(),
        bags=bags,
    )
    message.parameters.header.stamp = stamp
    if result.refined is not None:
        message.refined_estimates = [
            _message(msg.ParameterEstimate, parameter, remark="")
            for parameter in result.refined.parameters
        ]
    return message


def _message(kind: type[M], part: object, **given: object) -> M:
    """Fill a message from the attributes of `part` and what is given beside them.

    Numbers that are None are NaN, words that are None are empty; without a part all are.
    """
    forms: Mapping[str, str] = kind.get_fields_and_field_types()  # type: ignore[attr-defined]
    if part is not None and kind in _OTHER_NAMES:
        given = {**_OTHER_NAMES[kind](part), **given}
    return kind(
        **{
            name: _value(
                form,
                given[name] if name in given else None if part is None else getattr(part, name),
            )
            for name, form in forms.items()
            if not form.startswith("std_msgs/")
        }
    )


def _value(form: str, value: Any) -> object:
    """Convert a value to the type of a field: ``double``, ``sequence<string>`` and so on."""
    if form.startswith("sequence<"):
        inner = form.removeprefix("sequence<").removesuffix(">")
        return [_value(inner, item) for item in (() if value is None else value)]
    if form.startswith(_PACKAGE):
        return _message(getattr(msg, form.removeprefix(_PACKAGE)), value)
    if form == "double":
        return float("nan") if value is None else float(value)
    if form == "string":
        return value or ""
    return value or 0 if form.startswith("uint") else bool(value)


def _cause(cause: Cause) -> dict[str, object]:
    return {**vars(cause.evidence), "parameters": _named(cause.parameters)}


def _hint(hint: Hint) -> dict[str, object]:
    return {"parameters": _named(hint.parameters)}


def _named(parameters: Mapping[str, EffectParameter]) -> list["_Named"]:
    return [_Named(name, parameter) for name, parameter in parameters.items()]


class _Named:
    """A number of an effect with its name: what an estimate of no regression has."""

    expression = remark = ""
    essential = False
    relative_std_percent = ls_value = given_value = None

    def __init__(self, name: str, number: EffectParameter) -> None:
        self.name, self.unit = name, number.unit
        self.value, self.std = number.value, number.std


def _chain(chain: SignalChain) -> dict[str, object]:
    return {
        "effort_shift": _Named("effort_shift", chain.effort_shift),
        "joint_shifts": _named(chain.joint_shifts),
    }


def _in_order(stage: Stage, joints: Sequence[str]) -> dict[str, object]:
    intervals = [stage.torque_ci95.get(joint, (None, None)) for joint in joints]
    return {
        "stage": stage.name,
        "torque_rms": [stage.torque_rms.get(joint) for joint in joints],
        "torque_rms_low": [low for low, _ in intervals],
        "torque_rms_high": [high for _, high in intervals],
        "tracking_rms": [(stage.tracking_rms or {}).get(joint) for joint in joints],
    }


def _test(test: HypothesisTest) -> dict[str, object]:
    kind = msg.InstrumentTest
    outcome = {None: kind.NOT_RUN, True: kind.ACCEPTED, False: kind.REJECTED}[test.accepted]
    return {"null_hypothesis": test.null, "outcome": outcome}


def _residual(residual: JointResidual) -> dict[str, object]:
    kind = msg.ResidualDiagnosis
    whiteness = {None: kind.NOT_TESTED, True: kind.WHITE, False: kind.AUTOCORRELATED}
    return {"whiteness": whiteness[residual.white]}


def _interval(name: str) -> Callable[[Any], dict[str, object]]:
    """The 95 % interval of an attribute as two fields."""
    ends = (f"{name}_low", f"{name}_high")
    return lambda part: dict(zip(ends, part.ci95 or (None, None), strict=True))


# What is not filled by an attribute of its name.
_OTHER_NAMES: dict[type, Callable[[Any], dict[str, object]]] = {
    msg.GapCause: _cause,
    msg.GapChange: _interval("shrinkage"),
    msg.GapHint: _hint,
    msg.GapRegime: _interval("lift"),
    msg.GapSignalChain: _chain,
    msg.InstrumentTest: _test,
    msg.ResidualDiagnosis: _residual,
}
