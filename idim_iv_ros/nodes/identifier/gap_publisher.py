"""The last diagnosis: published latched, kept over a restart."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

from rclpy.node import Node

from idim_iv_interfaces.msg import GapReport
from idim_iv_ros.diagnosis.result import GapResult
from idim_iv_ros.documents import Document
from idim_iv_ros.errors import IdimError
from idim_iv_ros.files import GAP
from idim_iv_ros.nodes.entry import LATCHED, time_message
from idim_iv_ros.nodes.identifier.messages import gap_message

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
