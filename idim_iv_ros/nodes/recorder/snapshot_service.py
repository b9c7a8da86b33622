"""Snapshots of the recorder: the service, errors on /diagnostics, and the thread that writes."""

import time
from collections.abc import Callable
from concurrent.futures import Future

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node

from idim_iv_ros.errors import IdimError, UsageError
from idim_iv_ros.nodes.entry import in_thread
from idim_iv_ros.nodes.recorder.session import RecordingSession
from idim_iv_ros.nodes.recorder.threads import WriterThread
from idim_iv_ros.recording.writing.growing_bag import ClosedBag


class ErrorWatch:
    """Errors of other nodes on /diagnostics that were not there before.

    What begins with one of the names `excepted` is the recorder's: a full disk takes no snapshot.
    """

    def __init__(self, excepted: tuple[str, ...]) -> None:
        self._excepted = excepted
        self._errors: set[str] = set()

    def new(self, array: DiagnosticArray) -> list[str]:
        """``name: message`` of each status that has just become an error."""
        fresh = []
        for status in array.status:
            if status.name.startswith(self._excepted):
                continue
            if status.level != DiagnosticStatus.ERROR:
                self._errors.discard(status.name)
            elif status.name not in self._errors:
                self._errors.add(status.name)
                fresh.append(f"{status.name}: {status.message}")
        return fresh


class SnapshotService:
    """Takes snapshots, one at a time.

    `drain` hands everything that has arrived to the writer; `announce` takes the bag when it is
    complete.
    """

    def __init__(
        self,
        node: Node,
        writer: WriterThread,
        drain: Callable[[], None],
        announce: Callable[[ClosedBag], object],
    ) -> None:
        self._node, self._writer = node, writer
        self._drain, self._announce = drain, announce
        self._writing: Future[None] | None = None
        self._errors = ErrorWatch((node.get_name(), node.get_fully_qualified_name()))
        self._taken = float("-inf")
        node.create_subscription(DiagnosticArray, "/diagnostics", self._diagnosed, 100)

    @property
    def _session(self) -> RecordingSession:
        return self._writer.session

    def take(self) -> str:
        """Begin to write a snapshot and say into which folder.

        Raises
        ------
        UsageError
            There is nothing to write, or the last one is still being written.
        """
        if self._writing is not None and not self._writing.done():
            raise UsageError("the last snapshot is still being written")
        self._drain()
        folder, write = self._writer.call(self._session.snapshot)

        def work() -> None:
            try:
                closed = write()
            except OSError as error:
                reason = error.strerror or error
                self._node.get_logger().error(f"the snapshot could not be written: {reason}")
            else:
                self._announce(closed)

        self._taken = time.monotonic()
        self._writing = in_thread(work, "snapshot")
        return f"the last {self._session.ring.span:.1f} s go into {folder}"

    def close(self) -> None:
        """Wait for a snapshot that is being written."""
        if self._writing is not None:
            self._writing.exception()

    def _diagnosed(self, array: DiagnosticArray) -> None:
        new = self._errors.new(array)
        settings = self._session.settings
        recent = time.monotonic() - self._taken < settings.snapshot_duration
        if not new or recent or not (settings.snapshot_on_error and settings.snapshot_duration):
            return
        log = self._node.get_logger()
        try:
            log.error(f"{new[0]}: {self.take()}")
        except (IdimError, TimeoutError) as error:
            log.error(f"{new[0]}: {error}")
