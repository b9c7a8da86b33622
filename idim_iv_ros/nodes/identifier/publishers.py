"""The last results: published latched, compared with earlier ones, kept over a restart."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from idim_iv_interfaces.msg import DriftReport, GapReport, IdentificationResult, ParameterEstimates
from idim_iv_interfaces.srv import GetHistory, SetBaseline
from idim_iv_ros.diagnosis.result import GapResult
from idim_iv_ros.documents import Document
from idim_iv_ros.errors import IdimError, UsageError
from idim_iv_ros.files import GAP, RESULT
from idim_iv_ros.identification import result as identification
from idim_iv_ros.nodes.entry import LATCHED, time_message
from idim_iv_ros.nodes.identifier.estimate_history import (
    Comparison,
    EstimateHistory,
    PastEstimates,
)
from idim_iv_ros.nodes.identifier.job import ESTIMATORS, Job
from idim_iv_ros.nodes.identifier.messages import gap_message, result_message
from idim_iv_ros.nodes.identifier.report import (
    drift_diagnosis,
    drift_report,
    joint_diagnoses,
    past_identification,
)
from idim_iv_ros.nodes.identifier.settings import IdentifierSettings


class ResultPublisher:
    """Topics `~/estimates`, `~/result` and `~/drift`, services on the history of estimates.

    The topics hold the newest result by IDIM-IV with the node's own configuration, once there is
    one: what somebody asks for with another estimator or configuration is answered to who asked.

    Attributes
    ----------
    last : IdentificationResult or None
        Of the job that ended last.
    """

    def __init__(self, node: Node, directory: Path, significance: Callable[[], float]) -> None:
        self._node, self._directory, self._significance = node, directory, significance
        self._read: EstimateHistory | None = None
        self._comparisons: list[Comparison] = []
        self._shown: IdentificationResult | None = None
        self._entry: PastEstimates | None = None
        self.last: IdentificationResult | None = None
        self._estimates = node.create_publisher(ParameterEstimates, "~/estimates", LATCHED)
        self._results = node.create_publisher(IdentificationResult, "~/result", LATCHED)
        self._drifts = node.create_publisher(DriftReport, "~/drift", LATCHED)
        node.create_service(GetHistory, "~/get_history", self._get_history)
        node.create_service(SetBaseline, "~/set_baseline", self._set_baseline)

    def load(self) -> None:
        """Read the history in the output directory.

        Raises
        ------
        DataError
            It cannot be read.
        """
        self._read = EstimateHistory(self._directory)

    def forget(self) -> None:
        """Hold no history until it is read again."""
        self._read = self._shown = self._entry = None
        self._comparisons = []

    @property
    def _history(self) -> EstimateHistory:
        if self._read is None:
            raise UsageError("the identifier is unconfigured: no history was read")
        return self._read

    def publish_last(self) -> None:
        """Publish the newest result of the history whose file can be read, and what drifts."""
        newest_first = self._history.entries[::-1]
        for entry in sorted(newest_first, key=lambda each: not _own(each)):
            try:
                self._show(entry, self._message(entry))
                break
            except IdimError as error:
                self._node.get_logger().warning(str(error))
        self._compare()

    def add(self, job: Job, settings: IdentifierSettings) -> None:
        """Publish and keep the result of a job that has ended.

        Raises
        ------
        UsageError
            Its result.json cannot be read, or the history cannot be written.
        """
        assert job.folder is not None
        result = identification.IdentificationResult.read(job.folder / RESULT)
        entry = PastEstimates(
            stamp=self._node.get_clock().now().nanoseconds or time.time_ns(),
            robot=result.robot,
            estimator=result.estimator,
            effort_unit=result.effort_unit,
            bags=job.names,
            folder=job.folder.name,
            values={
                parameter.name: (parameter.value, parameter.std) for parameter in result.parameters
            },
            configuration=job.configuration_name,
        )
        self.last = result_message(result, time_message(entry.stamp), entry.bags, entry.folder)
        if _own(entry) or self._entry is None or not _own(self._entry):
            self._show(entry, self.last)
        self._history.add(entry, settings.history_length)
        self._compare()
        newest = self._comparisons[-1]
        if newest.drifting:
            assert newest.baseline is not None
            names = ", ".join(drift.parameter for drift in newest.drifting)
            since = ", ".join(newest.baseline.bags)
            self._node.get_logger().warning(f"changed since {since}: {names}")

    def diagnoses(self, name: str) -> list[DiagnosticStatus]:
        """The verdict on each joint and the drift; nothing before the first result."""
        joints = [] if self._shown is None else joint_diagnoses(name, self._shown)
        return [*joints, drift_diagnosis(name, self._comparisons)] if self._comparisons else joints

    def _compare(self) -> None:
        self._comparisons = self._history.comparisons(self._significance())
        if self._comparisons:
            self._drifts.publish(drift_report(self._comparisons))

    def _message(self, entry: PastEstimates) -> IdentificationResult:
        path = self._directory / entry.folder / RESULT
        result = identification.IdentificationResult.read(path)
        return result_message(result, time_message(entry.stamp), entry.bags, entry.folder)

    def _show(self, entry: PastEstimates, message: IdentificationResult) -> None:
        self._shown, self._entry = message, entry
        self._estimates.publish(message.parameters)
        self._results.publish(message)

    def _get_history(
        self, request: GetHistory.Request, response: GetHistory.Response
    ) -> GetHistory.Response:
        response.identifications = [
            past_identification(each)
            for each in ([] if self._read is None else self._read.entries)
            if request.estimator in ("", each.estimator)
        ]
        return response

    def _set_baseline(
        self, request: SetBaseline.Request, response: SetBaseline.Response
    ) -> SetBaseline.Response:
        try:
            shown = "" if self._entry is None else self._entry.folder
            entry = self._history.set_baseline(request.folder or shown)
            self._compare()
            response.success = True
            response.message = f"later identifications are compared with {', '.join(entry.bags)}"
        except IdimError as error:
            response.success, response.message = False, str(error)
        self._node.get_logger().info(response.message)
        return response


def _own(entry: PastEstimates) -> bool:
    """Whether the topics show it."""
    return not entry.configuration and entry.estimator == ESTIMATORS[0]


FILE = "last_gap.json"


@dataclass(frozen=True, kw_only=True)
class _LastGap(Document):
    """When the last diagnosis ended, of which bags, and the folder of its gap.json."""

    what: ClassVar[str] = "a record of the last diagnosis"
    written_by: ClassVar[str] = "serve"
    format: Literal["idim_iv_ros/last_gap/1"] = "idim_iv_ros/last_gap/1"
    stamp: int
    bags: tuple[str, ...]
    folder: str


class GapPublisher:
    """Topic `~/gap`.

    Attributes
    ----------
    last : GapReport or None
        What was published last.
    """

    def __init__(self, node: Node, directory: Path) -> None:
        self._node, self._directory = node, directory
        self.last: GapReport | None = None
        self._reports = node.create_publisher(GapReport, "~/gap", LATCHED)

    def publish_last(self) -> None:
        """Publish the last diagnosis that was kept, if its file can be read."""
        path = self._directory / FILE
        if not path.exists():
            return
        try:
            kept = _LastGap.read(path)
            self._publish(kept.stamp, kept.bags, Path(kept.folder).name)
        except IdimError as error:
            self._node.get_logger().warning(str(error))

    def add(self, stamp: int, bags: Sequence[str], folder: str) -> None:
        """Publish and keep a diagnosis.

        Parameters
        ----------
        stamp
            When it ended, ns since 1970.
        bags
            Relative to the bag directory.
        folder
            Of its gap.json, relative to the output directory.

        Raises
        ------
        IdimError
            Its gap.json cannot be read, or it cannot be kept.
        """
        self._publish(stamp, bags, folder)
        _LastGap(stamp=stamp, bags=tuple(bags), folder=folder).write(self._directory / FILE)

    def _publish(self, stamp: int, bags: Sequence[str], folder: str) -> None:
        result = GapResult.read(self._directory / folder / GAP)
        self.last = gap_message(result, time_message(stamp), bags, folder)
        self._reports.publish(self.last)
