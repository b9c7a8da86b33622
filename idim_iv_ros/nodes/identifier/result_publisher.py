"""The last good result: published latched, compared with earlier ones, kept over a restart."""

import time
from pathlib import Path

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from idim_iv_interfaces.msg import IdentificationResult, ParameterEstimates
from idim_iv_ros.errors import IdimError
from idim_iv_ros.files import RESULT
from idim_iv_ros.identification import result as identification
from idim_iv_ros.nodes.identifier.estimate_history import EstimateHistory, PastEstimates
from idim_iv_ros.nodes.identifier.job import Job
from idim_iv_ros.nodes.identifier.messages import result_message
from idim_iv_ros.nodes.identifier.report import drift_diagnosis, joint_diagnoses
from idim_iv_ros.nodes.identifier.settings import IdentifierSettings
from idim_iv_ros.statistics.drift import Drift


class ResultPublisher:
    """Topics `~/estimates` and `~/result`, and the history of estimates.

    Attributes
    ----------
    last : IdentificationResult or None
        What was published last.

    Raises
    ------
    DataError
        The history in the output directory cannot be read.
    """

    def __init__(self, node: Node, directory: Path) -> None:
        self._node, self._directory = node, directory
        self._history = EstimateHistory(directory)
        self._drifts: list[Drift] = []
        self.last: IdentificationResult | None = None
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._estimates = node.create_publisher(ParameterEstimates, "~/estimates", latched)
        self._results = node.create_publisher(IdentificationResult, "~/result", latched)

    def publish_last(self, significance: float) -> None:
        """Publish the newest result of the history whose file can be read."""
        for entry in reversed(self._history.entries):
            try:
                self._publish(entry)
            except IdimError as error:
                self._node.get_logger().warning(str(error))
                continue
            self._drifts = self._history.drifts(significance)
            return

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
            values={each.name: (each.value, each.std) for each in result.parameters},
        )
        self._publish(entry)
        self._history.add(entry, settings.history_length)
        self._drifts = self._history.drifts(settings.drift_significance)
        found = [drift.parameter for drift in self._drifts if drift.drifts]
        if found:
            log = self._node.get_logger()
            log.warning(f"changed since {', '.join(self._drifts[0].since)}: {', '.join(found)}")

    def diagnoses(self, name: str) -> list[DiagnosticStatus]:
        """The verdict on each joint and the drift; nothing before the first result."""
        if self.last is None:
            return []
        bags = self.last.parameters.bags
        return [*joint_diagnoses(name, self.last), drift_diagnosis(name, self._drifts, bags)]

    def _publish(self, entry: PastEstimates) -> None:
        stamp = Time(sec=entry.stamp // 1_000_000_000, nanosec=entry.stamp % 1_000_000_000)
        path = self._directory / entry.folder / RESULT
        result = identification.IdentificationResult.read(path)
        self.last = result_message(result, stamp, entry.bags, entry.folder)
        self._estimates.publish(self.last.parameters)
        self._results.publish(self.last)
