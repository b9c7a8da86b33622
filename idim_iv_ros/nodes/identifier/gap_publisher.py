"""The last diagnosis: published latched, kept over a restart."""

from collections.abc import Sequence
from pathlib import Path

from builtin_interfaces.msg import Time
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from idim_iv_interfaces.msg import GapReport
from idim_iv_ros.errors import IdimError
from idim_iv_ros.files import GAP, GAP_FORMAT
from idim_iv_ros.nodes.identifier.documents import read_document, write_document
from idim_iv_ros.nodes.identifier.gap_messages import gap_message

FORMAT = "idim_iv_ros/last_gap/1"
FILE = "last_gap.json"


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
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._reports = node.create_publisher(GapReport, "~/gap", latched)

    def publish_last(self) -> None:
        """Publish the last diagnosis that was kept, if its file can be read."""
        path = self._directory / FILE
        if not path.exists():
            return
        try:
            kept = read_document(path, FORMAT)
            self._publish(int(kept["stamp"]), kept["bags"], Path(kept["folder"]).name)
        except (IdimError, KeyError, TypeError, ValueError) as error:
            self._node.get_logger().warning(f"{path}: {error}")

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
        kept = {"format": FORMAT, "stamp": stamp, "bags": list(bags), "folder": folder}
        write_document(self._directory / FILE, kept)

    def _publish(self, stamp: int, bags: Sequence[str], folder: str) -> None:
        time = Time(sec=stamp // 1_000_000_000, nanosec=stamp % 1_000_000_000)
        document = read_document(self._directory / folder / GAP, GAP_FORMAT)
        self.last = gap_message(document, time, bags, folder)
        self._reports.publish(self.last)
