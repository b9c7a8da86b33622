"""Publishers of the last results, latched, and of their comparison with earlier ones."""

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from idim_iv_interfaces import msg
from idim_iv_interfaces.srv import GetHistory, SetBaseline
from idim_iv_ros.diagnosis.result.document import GapResult, Stage
from idim_iv_ros.effects.cause import EffectParameter
from idim_iv_ros.errors import IdimError, UsageError
from idim_iv_ros.files import GAP, REPORT, RESULT
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.nodes.entry import LATCHED
from idim_iv_ros.nodes.identifier.estimate_history import (
    Comparison,
    EstimateHistory,
    PastEstimates,
    drift_diagnosis,
    drift_report,
)
from idim_iv_ros.nodes.identifier.job_queue import ESTIMATORS, Job
from idim_iv_ros.nodes.messages import OtherNames, diagnostic_status, message_of
from idim_iv_ros.nodes.settings import IdentifierSettings

_LEVELS = {"valid": DiagnosticStatus.OK, "misspecified": DiagnosticStatus.ERROR}  # others are WARN


class ResultPublisher:
    """Topics `~/estimates`, `~/result` and `~/drift`, services on the history of estimates.

    The topics carry the newest result by IDIM-IV with the node's configuration, once there is one;
    results with another estimator or configuration go to their client alone. `last` is the result
    of the job that ended last.
    """

    def __init__(self, node: Node, directory: Path, settings: Callable[[], IdentifierSettings]):
        self._node, self._directory, self._settings = node, directory, settings
        self.last: msg.IdentificationResult | None = None
        self._estimates = node.create_publisher(msg.ParameterEstimates, "~/estimates", LATCHED)
        self._results = node.create_publisher(msg.IdentificationResult, "~/result", LATCHED)
        self._drifts = node.create_publisher(msg.DriftReport, "~/drift", LATCHED)
        self.forget()
        node.create_service(GetHistory, "~/get_history", self._get_history)
        node.create_service(SetBaseline, "~/set_baseline", self._set_baseline)

    def forget(self) -> None:
        """Drop the history and the published result until `publish_last` reads them again."""
        self._history: EstimateHistory | None = None
        self._comparisons: list[Comparison] = []
        self._shown: tuple[PastEstimates, msg.IdentificationResult] | None = None

    def publish_last(self) -> None:
        """Read the history; publish the newest result whose file can be read, and its drift."""
        self._history = EstimateHistory(self._directory)
        # The newest that may be shown; without any, the newest of all.
        for entry in sorted(self._history.entries, key=_is_shown)[::-1]:
            try:
                result = IdentificationResult.read(self._directory / entry.folder / RESULT)
            except IdimError as error:
                self._node.get_logger().warning(str(error))
                continue
            self._show(entry, result_message(result, entry.stamp, entry.bags, entry.folder))
            break
        self._compare(self._history)

    def add(self, job: Job) -> None:
        """Publish the result of a job that has ended, and save it in the history."""
        assert job.folder is not None
        history = self._required_history()
        result = IdentificationResult.read(job.folder / RESULT)
        entry = PastEstimates(
            stamp=_now(self._node),
            robot=result.robot,
            estimator=result.estimator,
            effort_unit=result.effort_unit,
            bags=job.names,
            folder=job.folder.name,
            values={item.name: (item.value, item.std) for item in result.parameters},
            configuration=job.configuration_name,
        )
        self.last = result_message(result, entry.stamp, entry.bags, entry.folder)
        if _is_shown(entry) or self._shown is None or not _is_shown(self._shown[0]):
            self._show(entry, self.last)
        history.add(entry, self._settings().history_length)
        self._compare(history)
        newest = self._comparisons[-1]
        if names := ", ".join(drift.name for drift in newest.drifting):
            self._node.get_logger().warning(f"changed since {newest.compared_with}: {names}")

    def diagnoses(self, name: str) -> list[DiagnosticStatus]:
        """Return the status of each joint and of the drift; none before the first result."""
        joints = [] if self._shown is None else _joint_diagnoses(name, self._shown[1])
        return [*joints, drift_diagnosis(name, self._comparisons)] if self._comparisons else joints

    def _required_history(self) -> EstimateHistory:
        if self._history is None:
            raise UsageError("the identifier is unconfigured: no history was read")
        return self._history

    def _compare(self, history: EstimateHistory) -> None:
        self._comparisons = history.comparisons(self._settings().drift_significance)
        if self._comparisons:
            self._drifts.publish(drift_report(self._comparisons))

    def _show(self, entry: PastEstimates, message: msg.IdentificationResult) -> None:
        self._shown = entry, message
        self._estimates.publish(message.parameters)
        self._results.publish(message)

    def _get_history(
        self, request: GetHistory.Request, response: GetHistory.Response
    ) -> GetHistory.Response:
        entries = [] if self._history is None else self._history.entries
        wanted = [entry for entry in entries if request.estimator in ("", entry.estimator)]
        response.identifications = [entry.to_message() for entry in wanted]
        return response

    def _set_baseline(
        self, request: SetBaseline.Request, response: SetBaseline.Response
    ) -> SetBaseline.Response:
        try:
            history = self._required_history()
            shown = "" if self._shown is None else self._shown[0].folder
            entry = history.set_baseline(request.folder or shown)
            self._compare(history)
            response.success = True
            response.message = f"later identifications are compared with {', '.join(entry.bags)}"
        except IdimError as error:
            response.success, response.message = False, str(error)
        self._node.get_logger().info(response.message)
        return response


def _now(node: Node) -> int:
    """Return the node's time, ns; the system's time where simulated time has not begun."""
    return node.get_clock().now().nanoseconds or time.time_ns()


def _is_shown(entry: PastEstimates) -> bool:
    return not entry.configuration and entry.estimator == ESTIMATORS[0]


def _joint_diagnoses(name: str, result: msg.IdentificationResult) -> list[DiagnosticStatus]:
    statuses = []
    for residual in result.residuals:
        level = _LEVELS.get(residual.verdict, DiagnosticStatus.WARN)
        joint, sentence = residual.joint, residual.sentence
        values = {
            "verdict": residual.verdict,
            "bags": ", ".join(result.parameters.bags),
            f"residual, RMS ({result.effort_unit})": f"{residual.rms:.4g}",
            "residual (%)": f"{residual.relative_percent:.3g}",
            "order of its autoregressive model": residual.ar_order,
        }
        statuses.append(diagnostic_status(level, f"{name}: {joint}", joint, sentence, values))
    return statuses


class GapPublisher:
    """Topic `~/gap`; `last` is the message published last."""

    def __init__(self, node: Node, directory: Path) -> None:
        self._node, self._directory = node, directory
        self.last: msg.GapReport | None = None
        self._reports = node.create_publisher(msg.GapReport, "~/gap", LATCHED)

    def publish_last(self) -> None:
        """Publish the newest diagnosis in the output directory, if its file can be read."""
        files = self._directory.glob(f"diagnosis_*/{GAP}")
        newest = max(files, key=lambda file: file.stat().st_mtime_ns, default=None)
        if newest is None:
            return
        try:
            result = GapResult.read(newest)
            self._publish(result, newest.stat().st_mtime_ns, result.bags, newest.parent.name)
        except IdimError as error:
            self._node.get_logger().warning(str(error))

    def add(self, job: Job) -> None:
        """Publish the diagnosis of a job that has ended."""
        assert job.folder is not None
        result = GapResult.read(job.folder / GAP)
        self._publish(result, _now(self._node), job.names, job.folder.name)

    def _publish(self, result: GapResult, stamp: int, bags: Sequence[str], folder: str) -> None:
        self.last = gap_message(result, stamp, bags, folder)
        self._reports.publish(self.last)


def gap_message(result: GapResult, stamp: int, bags: Sequence[str], folder: str) -> msg.GapReport:
    """Return a diagnosis that ended at `stamp`, ns since 1970, as a message.

    `bags` are relative to the bag directory, the `folder` of its files to the output directory.
    """
    joints = [joint_gap.joint for joint_gap in result.where.joints]
    names = ("joint", "family", "share", "where")
    return message_of(
        msg.GapReport,
        result,
        _OTHER_NAMES,
        **{f"unexplained_{name}": getattr(result.unexplained, name, None) for name in names},
        header=stamp,
        joints=result.where.joints,
        regimes=result.where.regimes,
        stages=[_stage_message(stage, joints) for stage in result.stages],
        bags=bags,
        files=[f"{folder}/{name}" for name in (GAP, REPORT)],
        duration=sum(result.timing.values()),
    )


def result_message(
    result: IdentificationResult, stamp: int, bags: Sequence[str], folder: str
) -> msg.IdentificationResult:
    """Return an identification that ended at `stamp`, ns since 1970, as a message.

    `bags` are relative to the bag directory, the `folder` of its files to the output directory.
    """
    refined = result.refined
    parameters = message_of(
        msg.ParameterEstimates,
        result,
        header=stamp,
        iterations=0 if result.estimator == "idim-ls" else result.iterations,
        estimates=result.parameters,
        covariance=result.covariance.ravel(),
        bags=bags,
    )
    return message_of(
        msg.IdentificationResult,
        result,
        _OTHER_NAMES,
        parameters=parameters,
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


def _messages(parameters: Mapping[str, EffectParameter]) -> list[msg.ParameterEstimate]:
    """Return the parameters of an effect as messages; fields of a regression stay empty."""
    return [
        message_of(msg.ParameterEstimate, None, name=name, **vars(parameter))
        for name, parameter in parameters.items()
    ]


def _stage_message(stage: Stage, joints: Sequence[str]) -> msg.GapStage:
    intervals = [stage.torque_ci95.get(joint, (None, None)) for joint in joints]
    return message_of(
        msg.GapStage,
        stage,
        stage=stage.name,
        torque_rms=[stage.torque_rms.get(joint) for joint in joints],
        torque_rms_low=[low for low, _ in intervals],
        torque_rms_high=[high for _, high in intervals],
        tracking_rms=[(stage.tracking_rms or {}).get(joint) for joint in joints],
    )


def _interval_fields(name: str) -> Callable[[Any], dict[str, object]]:
    """Return a function from an object to its interval `ci95` as fields NAME_low, NAME_high."""
    ends = (f"{name}_low", f"{name}_high")
    return lambda part: dict(zip(ends, part.ci95 or (None, None), strict=True))


_TEST, _RESIDUAL = msg.InstrumentTest, msg.ResidualDiagnosis
_OUTCOMES = {None: _TEST.NOT_RUN, True: _TEST.ACCEPTED, False: _TEST.REJECTED}
_WHITENESS = {None: _RESIDUAL.NOT_TESTED, True: _RESIDUAL.WHITE, False: _RESIDUAL.AUTOCORRELATED}
# What is not filled by an attribute of its name.
_OTHER_NAMES: OtherNames = {
    msg.GapCause: lambda cause: {**vars(cause.evidence), "parameters": _messages(cause.parameters)},
    msg.GapChange: _interval_fields("shrinkage"),
    msg.GapHint: lambda hint: {"parameters": _messages(hint.parameters)},
    msg.GapRegime: _interval_fields("lift"),
    msg.GapSignalChain: lambda chain: {
        "effort_shift": _messages({"effort_shift": chain.effort_shift})[0],
        "joint_shifts": _messages(chain.joint_shifts),
    },
    _TEST: lambda test: {"null_hypothesis": test.null, "outcome": _OUTCOMES[test.accepted]},
    _RESIDUAL: lambda residual: {"whiteness": _WHITENESS[residual.white]},
}
