"""The node `recorder`: writes the topics of a robot into MCAP bags."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from functools import partial
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import ROSClock
from rclpy.node import Node
from std_srvs.srv import Trigger

from idim_iv_interfaces.msg import BagClosed, RecorderStatus, TopicStatus
from idim_iv_ros.errors import IdimError, UsageError
from idim_iv_ros.nodes.entry import Result, in_thread, run_node, steady_timer
from idim_iv_ros.nodes.messages import Diagnostics, diagnostic_status, message_of
from idim_iv_ros.nodes.parameters import NodeProgram
from idim_iv_ros.nodes.recorder.session import Intake, RecordingSession, State, WriterThread
from idim_iv_ros.nodes.recorder.topics import RecentCounts, TopicSet, topic_diagnosis
from idim_iv_ros.nodes.settings import RecorderSettings
from idim_iv_ros.recording.writing.growing_bag import ClosedBag, time_span

_LOOK = 0.1  # s between two looks for publishers
_CLOCK = "use_sim_time is true and /clock was not heard"
_SILENT_CLOCK = f"{_CLOCK} yet: nothing is recorded before"

ABOUT = """recorder: record the topics of a robot into MCAP bags.

  ros2 run idim_iv_ros recorder --ros-args -p configuration:=ROBOT.yaml -p bag_directory:=DIR
  ros2 service call /recorder/start std_srvs/srv/Trigger

Services: ~/start ~/stop ~/abort ~/pause ~/resume ~/split ~/snapshot.
Topics: ~/status ~/bag_closed /diagnostics.
Parameters: ros2 param describe /recorder NAME."""


class Recorder(NodeProgram[RecorderSettings]):
    """The node `recorder`: services and topics around the threads that take and write messages."""

    def __init__(self, arguments: Sequence[str] = ()) -> None:
        super().__init__(Node("recorder"), RecorderSettings, arguments)
        node = self.node
        self._session = RecordingSession(self._settings, self._now, self._bag_ended)
        self._writer = WriterThread(self._session)
        self._topics = TopicSet(node, self._settings, node.get_logger().error)
        self._intake = Intake(self._writer, self._topics, self._log_time)
        self._status = node.create_publisher(RecorderStatus, "~/status", 10)
        self._bags = node.create_publisher(BagClosed, "~/bag_closed", 10)
        self._diagnostics = Diagnostics(node)
        self._counted: dict[str, int] = {}
        self._recent: dict[str, RecentCounts] = {}
        self._counted_at = time.monotonic()
        self._fault = self._sentence = ""
        self._snapshot: Future[None] | None = None  # one at a time is written
        self._snapshot_at = float("-inf")
        self._errors: set[str] = set()  # of other nodes
        session, call = self._session, self._call
        self._actions: dict[str, Callable[[], str]] = {
            "start": self._start,
            "stop": self._stop,
            "abort": lambda: f"{call(partial(session.stop, aborted=True)).folder}: given up",
            "pause": lambda: call(partial(session.go_on, State.PAUSED)),
            "resume": lambda: call(partial(session.go_on, State.RECORDING)),
            "split": lambda: f"closed {call(session.split)}",
            "snapshot": self._write_snapshot,
        }
        for name in self._actions:
            node.create_service(Trigger, f"~/{name}", partial(self._answer, name))
        node.create_subscription(DiagnosticArray, "/diagnostics", self._watch_errors, 100)
        steady_timer(node, _LOOK, self._topics.look)
        steady_timer(node, self._settings.status_period, self._report)
        self._follow_changes()
        self._writer.start()
        self._intake.start()
        self._topics.look()
        watched = ", ".join(topic.name for topic in self._topics.topics)
        folder = Path(self._settings.bag_directory).resolve()
        node.get_logger().info(f"ready: {watched}; bags go to {folder}")
        if self._settings.record:
            node.get_logger().info(self.act("start"))

    def close(self) -> None:
        """Close the bag, if one is open, and end the threads and the node."""
        self._intake.end()
        try:
            if self._session.bag is not None:
                self.act("stop")
        finally:
            if self._snapshot is not None:
                self._snapshot.exception()  # waits for it
            self._writer.end()
            self._topics.close()
            super().close()

    def _log_time(self) -> int | None:
        """Return the simulated time, ns, as rosbag2 does; None (time of receipt) without it."""
        clock = self.node.get_clock()
        simulated = isinstance(clock, ROSClock) and clock.ros_time_is_active
        return self._now() if simulated else None

    def _call(self, function: Callable[[], Result]) -> Result:
        """Hand all messages that have arrived to the writer, then run a function in its thread."""
        self._intake.drain()
        return self._writer.call(function)

    def _start(self) -> str:
        def start() -> str:
            folder = self._session.start()
            for topic in self._topics.topics:
                topic.monitor.reset()
                topic.too_large = 0
            self._writer.overrun = 0
            return f"recording into {folder}" + f"; {_SILENT_CLOCK}" * self._session.waits

        return self._call(start)

    def _stop(self) -> str:
        if self._call(self._session.stop).lost:
            raise UsageError(self._session.fault)
        return self._sentence

    def act(self, name: str) -> str:
        """Carry out the service of that name, and return a sentence on what was done."""
        return self._actions[name]()

    def _answer(
        self, name: str, _: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        try:
            response.success, response.message = True, self.act(name)
        except (IdimError, TimeoutError) as error:
            slow = isinstance(error, TimeoutError)
            why = "the disk did not answer for 10 s" if slow else str(error)
            response.success, response.message = False, why
        log = self.node.get_logger()
        if not response.success:
            log.error(response.message)
        elif name != "stop":  # what a bag holds is logged however it is closed
            log.info(response.message)
        return response

    def _report(self) -> None:
        """Publish ~/status, and the same in words on /diagnostics."""
        name = self.node.get_fully_qualified_name()
        session, bag, now = self._session, self._session.bag, time.monotonic()
        seconds, self._counted_at = now - self._counted_at, now
        counted, diagnoses = [], []
        for topic in self._topics.topics:
            received, content = topic.monitor.received, topic.monitor.content
            new = received - self._counted.get(topic.name, 0)
            self._counted[topic.name] = received
            status = message_of(
                TopicStatus,
                topic.monitor,
                name=topic.name,
                type=topic.channel and topic.channel.message_type,
                publishers=topic.publishers,
                rate=(new if new >= 0 else received) / seconds,
                recorded=session.recorded(topic.name),
                malformed=topic.too_large + (content.malformed if content else 0),
            )
            counted.append(status)
            recent = self._recent.setdefault(topic.name, RecentCounts()).since(status, now)
            diagnoses.append(topic_diagnosis(name, topic, status, recent))
        failure = session.fault or self._writer.failure or self._intake.failure
        waits = bag is not None and session.waits
        recording = session.state == State.RECORDING
        whole = message_of(
            RecorderStatus,
            None,
            header=self._now(),
            state=int(State.WAITING_FOR_CLOCK if waits and recording else session.state),
            bag=bag and str(bag.folder),
            file=bag and bag.file.path.name,
            splits=bag and len(bag.closed),
            duration=session.duration,
            bytes=bag and bag.size,
            free_disk=session.free_disk(),
            waiting=bag and bag.file.waiting,
            dropped=session.dropped + self._writer.overrun,
            fault=failure or (_SILENT_CLOCK if waits else ""),
            topics=counted,
        )
        self._status.publish(whole)
        level, sentence = DiagnosticStatus.OK, State(whole.state).name.lower()
        if whole.fault or whole.dropped:
            level = DiagnosticStatus.ERROR
            lost = f"{whole.dropped} messages could not be kept: memory_limit was reached"
            sentence = whole.fault or lost
        shown = ("bag", "file", "bytes", "waiting", "dropped")
        values = {item: getattr(whole, item) for item in shown}
        values |= {"duration (s)": f"{whole.duration:.1f}", "free disk (B)": whole.free_disk}
        if session.ring.duration:
            span, size = f"{session.ring.span:.1f}", session.ring.size
            values |= {"in memory (s)": span, "in memory (B)": size}
        recorder = diagnostic_status(level, f"{name}: recording", name, sentence, values)
        self._diagnostics.publish(recorder, *diagnoses)
        if whole.fault != self._fault:
            self._fault = whole.fault
            self.node.get_logger().error(whole.fault or "the fault is over")

    def _announce(self, closed: ClosedBag, faulty: bool = False) -> BagClosed:
        monitors = [topic.monitor for topic in self._topics.topics]
        shares = [m.received / (m.received + m.lost) for m in monitors if m.counts_lost]
        counts = ("lost", "late", "gaps")
        message = message_of(
            BagClosed,
            None,
            header=self._now(),
            bag=str(closed.folder),
            files=[file.name for file in closed.files],
            duration=time_span(closed.files)[1] * 1e-9,
            messages=sum(file.messages for file in closed.files),
            arrived=min(shares, default=math.nan),
            bytes=sum(file.size for file in closed.files),
            complete=not faulty,
            **{name: sum(getattr(monitor, name) for monitor in monitors) for name in counts},
        )
        self._bags.publish(message)
        return message

    def _bag_ended(self, closed: ClosedBag, faulty: bool) -> None:
        """Announce a closed bag, and say what it holds and lacks."""
        message, topics = self._announce(closed, faulty), self._topics.topics
        parts = [f"{message.messages} messages in {message.duration:.1f} s"]
        for what in ("lost", "late", "gaps"):
            names = ", ".join(topic.name for topic in topics if getattr(topic.monitor, what))
            parts.append(f"{getattr(message, what)} {what}" + (f" ({names})" if names else ""))
        if not math.isnan(message.arrived):
            # Rounded down: of a million with one lost, not all arrived.
            parts.append(f"{math.floor(1e4 * message.arrived) / 1e2:g} % arrived")
        troubles = [_CLOCK] if self._session.waits else []
        if kept_out := self._session.dropped + self._writer.overrun:
            troubles.append(f"{kept_out} arrived and could not be kept")
        troubles += [t.absence for t in topics if t.absence and not t.monitor.received]
        self._sentence = f"{message.bag}: {', '.join([*parts, *troubles])}"
        log = self.node.get_logger()
        if troubles or message.lost or message.gaps or not message.messages:
            log.warning(self._sentence)
        else:
            log.info(self._sentence)

    def _write_snapshot(self) -> str:
        """Begin to write a snapshot in another thread; return a sentence that names its folder."""
        if self._snapshot is not None and not self._snapshot.done():
            raise UsageError("the last snapshot is still being written")
        folder, write = self._call(self._session.snapshot)

        def work() -> None:
            try:
                self._announce(write())
            except OSError as error:
                reason = error.strerror or error
                self.node.get_logger().error(f"the snapshot could not be written: {reason}")

        self._snapshot_at = time.monotonic()
        self._snapshot = in_thread(work, "snapshot")
        return f"the last {self._session.ring.span:.1f} s go into {folder}"

    def _watch_errors(self, array: DiagnosticArray) -> None:
        # Without the recorder's errors: with a full disk a snapshot is impossible.
        mine = (self.node.get_name(), self.node.get_fully_qualified_name())
        errors = {
            status.name: f"{status.name}: {status.message}"
            for status in array.status
            if status.level == DiagnosticStatus.ERROR and not status.name.startswith(mine)
        }
        new = [error for name, error in errors.items() if name not in self._errors]
        self._errors = self._errors - {status.name for status in array.status} | errors.keys()
        duration = self._settings.snapshot_duration
        recent = time.monotonic() - self._snapshot_at < duration
        if not new or recent or not (self._settings.snapshot_on_error and duration):
            return
        try:
            said = self._write_snapshot()
        except (IdimError, TimeoutError) as error:
            said = str(error)
        self.node.get_logger().error(f"{new[0]}: {said}")

    def _refuse(self, given: Mapping[str, object]) -> str:
        before = self._settings.configuration
        if self._session.bag is not None and given.get("configuration", before) != before:
            return "configuration: a bag is open; call stop first"
        return ""

    def _apply(self, given: set[str]) -> None:
        settings = self._session.settings = self._settings
        self._session.ring.keep(settings.snapshot_duration, settings.snapshot_memory)
        if "configuration" in given:
            self._topics.configure(settings)
            self._call(self._session.forget)
        elif given & {"extra_topics", "extra_topics_regex"}:
            self._topics.extend(settings)


run = partial(run_node, "recorder", Recorder, ABOUT)
