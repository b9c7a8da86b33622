"""What the recorder says of a bag, of a clock that is silent, and of a topic."""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from rosbags.rosbag2 import Reader
from rosgraph_msgs.msg import Clock

from idim_iv_interfaces.msg import BagClosed, RecorderStatus, TopicStatus
from idim_iv_ros.nodes.recorder.node import Recorder
from idim_iv_ros.nodes.recorder.topic_monitor import JointContent, Received, TopicMonitor
from idim_iv_ros.nodes.recorder.topics import RECENT, RecentCounts, topic_diagnosis
from idim_iv_ros.nodes.settings import RecorderSettings
from idim_iv_ros.recording.bags.joint_message_type import JOINT_STATE
from idim_iv_ros.recording.writing.write import OfferedQos, TopicChannel
from tests.recording.bag_writer import STORE, joint_state
from tests.ros.processes import only_bag

JOINTS = TopicChannel("/told/joint_states", "sensor_msgs/msg/JointState")
LATCHED = TopicChannel(
    "/told/robot_description", "std_msgs/msg/String", (OfferedQos(durability="transient_local"),)
)
RAW = b"\0\1\0\0" + bytes(24)
STEP = 10_000_000  # ns


class Told:
    """A recorder in this process, and what it publishes."""

    def __init__(self, recorder: Recorder) -> None:
        self.recorder = recorder
        self.closed: list[BagClosed] = []
        self.statuses: list[RecorderStatus] = []
        recorder._bags.publish = self.closed.append
        recorder._status.publish = self.statuses.append

    def arrive(self, channel: TopicChannel, *sequence: int, late: int = 0) -> None:
        """Hand over messages as the intake does."""
        topic = next(t for t in self.recorder._topics.topics if t.name == channel.name)
        topic.channel, topic.had_publishers = channel, True
        taken = [
            (
                RAW,
                {
                    "received_timestamp": 10**18 + STEP * k + late,
                    "source_timestamp": 10**18 + STEP * k,
                    "publication_sequence_number": k,
                },
            )
            for k in sequence
        ]
        self.recorder._writer.submit(channel, topic.monitor, taken, self.recorder._log_time())

    def clock(self, seconds: int) -> None:
        self.recorder.node._time_source.clock_callback(Clock(clock=Time(sec=seconds)))

    def status(self) -> RecorderStatus:
        self.recorder._writer.call(self.recorder._report)
        return self.statuses[-1]


@pytest.fixture
def told(begin_ros, tmp_path: Path) -> Iterator[Callable[..., Told]]:
    """Start a recorder in this process."""
    with ExitStack() as stack:

        def start(**parameters: object) -> Told:
            values = {"bag_directory": tmp_path, "minimum_free_disk": 0, **parameters}
            begin_ros("-r", "__ns:=/told", **values)
            recorder = Recorder()
            stack.callback(recorder.close)
            return Told(recorder)

        yield start


def logged(bag: Path) -> dict[str, list[int]]:
    with Reader(bag) as reader:
        times: dict[str, list[int]] = {item.topic: [] for item in reader.connections}
        for connection, time, _ in reader.messages():
            times[connection.topic].append(time)
    return times


def test_stop_log_and_announcement_say_what_a_bag_lacks(told, capfd) -> None:
    said = told(late_after="0.5")
    said.recorder.act("start")
    said.arrive(JOINTS, *range(1, 41))
    said.arrive(JOINTS, *range(43, 60), *range(62, 101), late=10**9)
    said.arrive(LATCHED, 1)
    answer = said.recorder.act("stop")
    (closed,) = said.closed
    assert (closed.messages, closed.lost, closed.late, closed.gaps) == (97, 4, 56, 0)
    assert closed.arrived == pytest.approx(0.96)
    words = ("97 messages", "4 lost (/told/joint_states)", "56 late", "0 gaps", "96 % arrived")
    assert all(word in answer for word in words), answer
    assert answer in capfd.readouterr().err
    said.recorder.act("start")
    said.arrive(JOINTS, *range(101, 140), *range(200, 210))
    assert "1 gaps (/told/joint_states)" in said.recorder.act("stop")
    assert said.closed[1].gaps == 1


def test_a_bag_without_messages_is_a_warning(told, capfd) -> None:
    said = told()
    said.recorder.act("start")
    answer = said.recorder.act("stop")
    assert ": 0 messages " in answer
    assert "nobody publishes /told/joint_states" in answer
    assert math.isnan(said.closed[0].arrived)
    assert "[WARN]" in capfd.readouterr().err


def test_nothing_is_logged_at_time_zero(told, tmp_path: Path) -> None:
    said = told(use_sim_time="true")
    assert "/clock" in said.recorder.act("start")
    said.arrive(LATCHED, 1)
    said.arrive(JOINTS, 1, 2, 3)
    status = said.status()
    assert status.state == RecorderStatus.WAITING_FOR_CLOCK
    assert "/clock" in status.fault
    assert not any(topic.recorded for topic in status.topics)
    said.recorder.act("split")
    said.clock(7)
    said.arrive(JOINTS, 4, 5)
    assert said.status().state == RecorderStatus.RECORDING
    assert said.status().fault == ""
    said.clock(8)
    said.arrive(JOINTS, 6)
    said.recorder.act("stop")
    seven, eight = 7 * 10**9, 8 * 10**9
    times = logged(only_bag(tmp_path))
    assert times["/told/joint_states"] == [seven, seven, eight]
    assert times["/told/robot_description"] in ([seven], [eight])


OK, WARN, ERROR = 0, 1, 2
BOTH = ["position", "effort"]


def message(*names: str, effort: Sequence[float] | None = None) -> bytes:
    values = np.zeros(len(names))
    made = joint_state(1.0, names, values, effort=values if effort is None else effort)
    return bytes(STORE.serialize_cdr(made, JOINT_STATE))


def test_an_arm_in_two_messages_holds_all_joints_and_what_one_lacks_is_named() -> None:
    content = JointContent(JOINT_STATE, ["a", "b", "c"], BOTH)
    content.look([message("a", "b"), message("c")])
    assert content.problems == []
    content.look([message("c", effort=[np.nan])])
    assert content.problems == ["effort of c is NaN or missing"]


def test_a_joint_that_is_lost_is_said_until_it_is_found_again() -> None:
    content = JointContent(JOINT_STATE, ["a", "b"], BOTH)
    content.look([message("a", "b"), *[message("a")] * 50])
    assert content.problems == ["it does not hold joint b"]
    content.look([message("a", "b")])
    assert content.problems == []


@pytest.fixture
def clock() -> SimpleNamespace:
    """Monotonic time, s."""
    return SimpleNamespace(now=50.0)


def topic_of_period(clock: SimpleNamespace, period: float, count: int = 20) -> SimpleNamespace:
    """A topic with messages that came at a steady period, s, the last one now."""
    sent = np.arange(count) * round(1e9 * period)
    monitor = TopicMonitor(None, False, lambda: clock.now)
    batch = Received([b""] * count, sent + 1000, sent, np.arange(count))
    monitor.add(batch, RecorderSettings())
    return SimpleNamespace(
        name="/states",
        monitor=monitor,
        problem="",
        note="",
        publishers=1,
        had_publishers=True,
        substitutes=(),
        channel=SimpleNamespace(latched=False),
    )


def diagnosed(topic: SimpleNamespace, **recent: object) -> tuple[int, str]:
    status = topic_diagnosis("/recorder", topic, TopicStatus(rate=500.0), TopicStatus(**recent))
    return status.level[0], status.message


def test_silence_is_an_error_after_a_second_or_twenty_periods(clock: SimpleNamespace) -> None:
    fast, slow = topic_of_period(clock, 0.002), topic_of_period(clock, 0.2)
    clock.now += 0.9
    assert diagnosed(fast) == (OK, "500.0 Hz")
    clock.now += 0.2
    assert diagnosed(fast) == (ERROR, "no message for 1.1 s")
    clock.now += 2.8
    assert diagnosed(slow)[0] == OK
    clock.now += 0.2
    assert diagnosed(slow) == (ERROR, "no message for 4.1 s")
    fast.publishers = 0
    assert diagnosed(fast) == (ERROR, "its publisher is gone; last message 4.1 s ago")
    slow.channel.latched = True  # such a topic is never silent
    assert diagnosed(slow)[0] == OK


@pytest.mark.parametrize("what", ["lost", "late", "malformed", "backward", "gaps"])
def test_recent_incidents_are_warnings(clock: SimpleNamespace, what: str) -> None:
    level, sentence = diagnosed(topic_of_period(clock, 0.002), **{what: 3})
    assert (level, sentence[:2]) == (WARN, "3 ")


def test_an_incident_counts_for_a_while_and_from_zero_in_a_new_recording() -> None:
    recent = RecentCounts()
    assert recent.since(TopicStatus(received=10, gaps=2), 0.0).gaps == 2
    for second in range(1, 60):
        late = 3 if second >= 5 else 0
        rose = recent.since(TopicStatus(received=100 * second, late=late, gaps=2), float(second))
        assert rose.late == (3 if 5 <= second < 5 + RECENT else 0)
        assert rose.gaps == (2 if second < RECENT else 0)
    assert recent.since(TopicStatus(received=50, late=1), 60.0).late == 1
