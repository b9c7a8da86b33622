"""The recorder's reports on itself: RecorderStatus, BagClosed, and messages on /diagnostics."""

import math
from collections import deque
from collections.abc import Sequence

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from idim_iv_interfaces.msg import BagClosed, RecorderStatus, TopicStatus
from idim_iv_ros.nodes.messages import diagnostic_status, message_of
from idim_iv_ros.nodes.recorder.session import RecordingSession, SnapshotRing, State, WriterThread
from idim_iv_ros.nodes.recorder.topics import WatchedTopic
from idim_iv_ros.recording.writing.growing_bag import ClosedBag
from idim_iv_ros.types import IntArray

_SILENT = 1.0  # s, at least
_SILENT_PERIODS = 20.0
_CLOCK = "use_sim_time is true and /clock was not heard"
SILENT_CLOCK = f"{_CLOCK} yet: nothing is recorded before"
RECENT = 10.0  # s for which an incident is a warning; totals stay among the values
_INCIDENTS = {
    "lost": "lost",
    "late": "late",
    "malformed": "malformed or too large",
    "backward": "stamped before the one before",
}
_COUNTED = ("received", "lost", "late", "gaps", "malformed", "backward")


def topic_status(topic: WatchedTopic, session: RecordingSession, rate: float) -> TopicStatus:
    """Return the counts of one topic as a message; `rate` in Hz."""
    content = topic.monitor.content
    return message_of(
        TopicStatus,
        topic.monitor,
        name=topic.name,
        type=topic.channel and topic.channel.message_type,
        publishers=topic.publishers,
        rate=rate,
        recorded=session.recorded(topic.name),
        malformed=topic.too_large + (content.malformed if content else 0),
    )


def recorder_status(
    writer: WriterThread, topics: Sequence[TopicStatus], failure: str, stamp: int
) -> RecorderStatus:
    """Return the state of the recording as a message, with its fault; `stamp` is now, ns."""
    session = writer.session
    bag, state = session.bag, session.state
    if state == State.RECORDING and session.waits:
        state = State.WAITING_FOR_CLOCK
    return message_of(
        RecorderStatus,
        None,
        header=stamp,
        state=int(state),
        bag=bag and str(bag.folder),
        file=bag and bag.file.path.name,
        splits=bag and len(bag.closed),
        duration=session.duration,
        bytes=bag and bag.size,
        free_disk=session.free_disk(),
        waiting=bag and bag.file.waiting,
        dropped=session.dropped + writer.overrun,
        fault=session.fault or failure or (SILENT_CLOCK if bag and session.waits else ""),
        topics=topics,
    )


def bag_closed(
    closed: ClosedBag, faulty: bool, topics: Sequence[WatchedTopic], stamp: int
) -> BagClosed:
    """Return the announcement of a closed bag with its topics' counts; `stamp` is now, ns."""
    monitors = [topic.monitor for topic in topics]
    shares = [m.received / (m.received + m.lost) for m in monitors if m.counts_lost]
    counts = ("lost", "late", "gaps")
    return message_of(
        BagClosed,
        None,
        header=stamp,
        bag=str(closed.folder),
        files=[file.name for file in closed.files],
        duration=closed.duration * 1e-9,
        messages=sum(file.messages for file in closed.files),
        arrived=min(shares, default=math.nan),
        bytes=sum(file.size for file in closed.files),
        complete=not faulty,
        **{name: sum(getattr(monitor, name) for monitor in monitors) for name in counts},
    )


def bag_sentence(
    message: BagClosed, topics: Sequence[WatchedTopic], writer: WriterThread
) -> tuple[str, bool]:
    """Return a sentence on the content and losses of a closed bag, and whether it is a warning."""
    session = writer.session
    parts = [f"{message.messages} messages in {message.duration:.1f} s"]
    for what in ("lost", "late", "gaps"):
        names = ", ".join(topic.name for topic in topics if getattr(topic.monitor, what))
        parts.append(f"{getattr(message, what)} {what}" + (f" ({names})" if names else ""))
    if not math.isnan(message.arrived):
        # Rounded down: of a million with one lost, not all arrived.
        parts.append(f"{math.floor(1e4 * message.arrived) / 1e2:g} % arrived")
    troubles = [_CLOCK] if session.waits else []
    if kept_out := session.dropped + writer.overrun:
        troubles.append(f"{kept_out} arrived and could not be kept")
    troubles += [t.absence for t in topics if t.absence and not t.monitor.received]
    warns = bool(troubles or message.lost or message.gaps or not message.messages)
    return f"{message.bag}: {', '.join([*parts, *troubles])}", warns


def recorder_diagnosis(name: str, status: RecorderStatus, ring: SnapshotRing) -> DiagnosticStatus:
    """Return the recorder's status; `ring` holds the messages of a snapshot."""
    level, sentence = DiagnosticStatus.OK, State(status.state).name.lower()
    if status.fault:
        level, sentence = DiagnosticStatus.ERROR, status.fault
    elif status.dropped:
        level = DiagnosticStatus.ERROR
        sentence = f"{status.dropped} messages could not be kept: memory_limit was reached"
    values = {
        name: getattr(status, name) for name in ("bag", "file", "bytes", "waiting", "dropped")
    }
    values |= {"duration (s)": f"{status.duration:.1f}", "free disk (B)": status.free_disk}
    if ring.duration:
        values["in memory (s)"], values["in memory (B)"] = f"{ring.span:.1f}", ring.size
    return diagnostic_status(level, f"{name}: recording", name, sentence, values)


class RecentCounts:
    """Increase of the counts of a topic within the last `RECENT` seconds.

    A status takes its level from these: one late message does not make a long recording faulty.
    """

    def __init__(self) -> None:
        self._seen: deque[tuple[float, IntArray]] = deque()

    def since(self, status: TopicStatus, now: float) -> TopicStatus:
        """Return a status with the increase of its counts; `now`, s, must not decrease."""
        counts = np.array([getattr(status, name) for name in _COUNTED])
        if self._seen and np.any(counts < self._seen[-1][1]):
            self._seen.clear()  # counted from zero: a new recording, or another publisher
        self._seen.append((now, counts))
        while len(self._seen) > 1 and now - self._seen[1][0] >= RECENT:
            self._seen.popleft()
        begin, before = self._seen[0]
        recent = counts if now - begin < RECENT else counts - before
        rose = dict(zip(_COUNTED, recent.tolist(), strict=True))
        return TopicStatus(rate=status.rate, longest_gap=status.longest_gap, **rose)


def topic_diagnosis(
    name: str, topic: WatchedTopic, status: TopicStatus, recent: TopicStatus
) -> DiagnosticStatus:
    """Return the status of one topic: level from the `recent` counts, values from `status`."""
    monitor = topic.monitor
    latched = topic.channel is None or topic.channel.latched
    longest = max(_SILENT, _SILENT_PERIODS * (monitor.period or 0.0))
    errors = [topic.problem] if topic.problem else []
    if topic.had_publishers and topic.publishers == 0:
        errors.append(f"its publisher is gone; last message {monitor.silence:.1f} s ago")
    elif topic.had_publishers and not latched and monitor.silence > longest:
        errors.append(f"no message for {monitor.silence:.1f} s")
    warnings = []
    substituted = any(other.had_publishers for other in topic.substitutes)
    if not topic.had_publishers and not topic.problem and not substituted:
        warnings.append("nobody publishes it")
    if topic.note:
        warnings.append(topic.note)
    if topic.publishers > 1:
        warnings.append(f"{topic.publishers} publishers: lost messages cannot be counted")
    if monitor.content is not None:
        warnings += monitor.content.problems
    for counted, what in _INCIDENTS.items():
        if count := getattr(recent, counted):
            warnings.append(f"{count} messages {what}")
    if recent.gaps:
        words = f"the longest of the recording {recent.longest_gap:.3f} s"
        warnings.append(f"{recent.gaps} gaps; {words}")
    level = DiagnosticStatus.OK
    if errors or warnings:
        level = DiagnosticStatus.ERROR if errors else DiagnosticStatus.WARN
    sentence = "; ".join(errors + warnings) or f"{status.rate:.1f} Hz"
    counts = ("publishers", "received", "recorded", "lost", "late", "gaps", "malformed", "bytes")
    values = {
        "rate (Hz)": f"{status.rate:.1f}",
        **{name: getattr(status, name) for name in counts},
        "longest gap (s)": f"{status.longest_gap:.4f}",
        "backward stamps": status.backward,
    }
    return diagnostic_status(level, f"{name}: {topic.name}", topic.name, sentence, values)
