"""Results as messages: a field of a message has the name of the attribute that fills it."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from idim_iv_interfaces import msg
from idim_iv_ros.diagnosis.result import EffectParameter, GapResult, Stage
from idim_iv_ros.files import GAP, REPORT, RESULT
from idim_iv_ros.identification.result import IdentificationResult, JointResidual
from idim_iv_ros.nodes.messages import OtherNames, message_of
from idim_iv_ros.statistics import HypothesisTest


def gap_message(result: GapResult, stamp: int, bags: Sequence[str], folder: str) -> msg.GapReport:
    """Return a diagnosis that ended at a time, ns since 1970, as a message.

    `bags` are relative to the bag directory, the `folder` of its files to the output directory.
    """
    joints = [joint_gap.joint for joint_gap in result.joint_gaps]
    unexplained = {
        f"unexplained_{name}": getattr(result.unexplained, name, None)
        for name in ("joint", "family", "share", "where")
    }
    return message_of(
        msg.GapReport,
        result,
        _OTHER_NAMES,
        **unexplained,
        header=stamp,
        joints=result.joint_gaps,
        stages=[
            message_of(msg.GapStage, stage, **_in_order(stage, joints)) for stage in result.stages
        ],
        bags=bags,
        files=[f"{folder}/{name}" for name in (GAP, REPORT)],
        duration=sum(result.timing.values()),
    )


def result_message(
    result: IdentificationResult, stamp: int, bags: Sequence[str], folder: str
) -> msg.IdentificationResult:
    """Return an identification as a message, as `gap_message` does a diagnosis."""
    refined = result.refined
    return message_of(
        msg.IdentificationResult,
        result,
        _OTHER_NAMES,
        parameters=message_of(
            msg.ParameterEstimates,
            result,
            header=stamp,
            iterations=0 if result.estimator == "idim-ls" else result.iterations,
            estimates=result.parameters,
            covariance=result.covariance.ravel(),
            bags=bags,
        ),
        instruments=result.instruments.tests,
        instruments_source=result.instruments.source,
        specification=result.specification.tests,
        exogeneity=result.exogeneity.tests,
        verdict=result.verdict.sentence,
        relative_error_percent=result.fit.relative_error_percent,
        condition_number=result.fit.condition_number,
        samples=result.fit.samples,
        refined=refined is not None,
        refined_estimates=[
            message_of(msg.ParameterEstimate, parameter, remark="")
            for parameter in (() if refined is None else refined.parameters)
        ],
        moved=() if refined is None else refined.moved,
        duration=sum(result.timing.values()),
        files=[f"{folder}/{name}" for name in (RESULT, REPORT)],
    )


def _named(parameters: Mapping[str, EffectParameter]) -> list[msg.ParameterEstimate]:
    """Return numbers of an effect, which have nothing of what only a regression has."""
    return [
        message_of(msg.ParameterEstimate, None, name=name, **vars(parameter))
        for name, parameter in parameters.items()
    ]


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
_OTHER_NAMES: OtherNames = {
    msg.GapCause: lambda cause: {**vars(cause.evidence), "parameters": _named(cause.parameters)},
    msg.GapChange: _interval("shrinkage"),
    msg.GapHint: lambda hint: {"parameters": _named(hint.parameters)},
    msg.GapRegime: _interval("lift"),
    msg.GapSignalChain: lambda chain: {
        "effort_shift": _named({"effort_shift": chain.effort_shift})[0],
        "joint_shifts": _named(chain.joint_shifts),
    },
    msg.InstrumentTest: _test,
    msg.ResidualDiagnosis: _residual,
}
