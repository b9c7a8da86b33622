"""What the recorder says of a bag, and of a clock that is silent; messages come from the test."""

import math
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from builtin_interfaces.msg import Time
from rosbags.rosbag2 import Reader
from rosgraph_msgs.msg import Clock

from idim_iv_interfaces.msg import BagClosed, RecorderStatus
from idim_iv_ros.nodes.recorder.node import Recorder
from idim_iv_ros.recording.writing.write import OfferedQos, TopicChannel
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
        time = Clock(clock=Time(sec=seconds))
        self.recorder.node._time_source.clock_callback(time)

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
    for words in (
        "97 messages",
        "4 lost (/told/joint_states)",
        "56 late",
        "0 gaps",
        "96 % arrived",
    ):
        assert words in answer
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
