"""What a user of the recorder relies on."""

import os
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from mcap.reader import make_reader
from nav_msgs.msg import Odometry
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import Temperature

from idim_iv_ros.recording.read import read_recordings
from tests.ros.processes import Process, numbers, only_bag

BOTH = [{"name": "/joint_states"}, {"name": "/joint_reference"}]


def test_start_to_stop_is_one_bag_with_every_message_that_other_readers_open(
    recorder, robot, observer, bags: Path, configuration: Path
) -> None:
    recorder(configuration=configuration)
    robot.begin(topics=BOTH, count=1000, rate=1000.0, description="<robot name='x'/>")
    observer.call("start")
    assert robot.run() == 1000
    observer.received(1000)
    observer.received(1000, "/joint_reference")
    observer.call("stop")
    observer.until(lambda: observer.closed, "the announcement")
    (closed,) = observer.closed
    bag = only_bag(bags)
    assert (Path(closed.bag), closed.messages, closed.lost, closed.complete) == (bag, 2001, 0, True)
    for topic in ("/joint_states", "/joint_reference"):
        assert np.array_equal(numbers(bag, topic), np.arange(1000.0))
    (recording,) = read_recordings([bag], joints=["a", "b"], reference="/joint_reference")
    assert recording.robot_description == "<robot name='x'/>"
    assert recording.position_reference is not None
    assert not any("ends in the middle" in note.what for note in recording.notes)
    with AnyReader([bag]) as reader:
        types = {connection.topic: connection.msgtype for connection in reader.connections}
        received = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages()]
    states = dict.fromkeys(("/joint_states", "/joint_reference"), "sensor_msgs/msg/JointState")
    assert types == {**states, "/robot_description": "std_msgs/msg/String"}
    assert len(received) == 2001
    (file,) = bag.glob("*.mcap")
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary.statistics.message_count == 2001
    assert all(b"uint32 nanosec" in s.data for s in summary.schemas.values() if "Joint" in s.name)
    assert all(index.compression == "zstd" for index in summary.chunk_indexes)


def test_latched_description_is_repeated_in_every_file_and_pauses_are_left_out(
    recorder, robot, observer, bags: Path
) -> None:
    recorder()
    robot.begin(count=100, description="<robot/>")
    observer.call("start")
    robot.run()
    observer.received(100)
    observer.call("pause")
    robot.begin(count=70).run()
    observer.received(170)
    observer.call("resume")
    observer.call("split")
    robot.begin(count=50).run()
    observer.received(220)
    observer.call("stop")
    bag = only_bag(bags)
    assert np.array_equal(numbers(bag), np.concatenate([np.arange(100.0), np.arange(50.0)]))
    files = sorted(bag.glob("*.mcap"))
    assert len(files) == 2
    for file in files:
        with AnyReader([file]) as reader:
            assert [c.topic for c, _, _ in reader.messages() if "description" in c.topic]


def test_size_and_time_begin_new_files(recorder, robot, observer, bags: Path) -> None:
    recorder(chunk_duration=0.1, max_file_size=5_000)
    robot.begin(count=500, rate=1000.0, pace=True)
    observer.call("start")
    robot.run()
    observer.received(500)
    observer.call("stop")
    by_size = only_bag(bags)
    assert len(list(by_size.glob("*.mcap"))) > 2
    assert np.array_equal(numbers(by_size), np.arange(500.0))
    assert observer.set(max_file_size=0, max_file_duration=0.2, bag_prefix="timed")[0].successful
    observer.call("start")
    robot.begin(count=800, rate=1000.0, pace=True).run()
    observer.received(800)
    observer.call("stop")
    (timed,) = bags.glob("timed*")
    assert len(list(timed.glob("*.mcap"))) > 2
    assert np.array_equal(numbers(timed), np.arange(800.0))


def test_requests_out_of_order_and_wrong_parameters_are_refused_in_one_line(
    recorder, observer, tmp_path: Path
) -> None:
    recorder()
    for name in ("stop", "abort", "pause", "resume", "split"):
        observer.refused(name, "call start first")
    observer.call("start")
    observer.refused("start", "call stop first")
    observer.call("stop")
    broken = tmp_path / "broken.yaml"
    broken.write_text("robot: {joints: [a], colour: red}\n")
    for name, value, words in (
        ("chunk_duration", 100.0, "range"),
        ("bag_prefix", "../up", "not the name of a folder"),
        ("configuration", str(broken), "unknown key robot.colour"),
        ("queue_depth", 50, "read-only"),
        ("late_after", "soon", "type"),
    ):
        (result,) = observer.set(**{name: value})
        assert not result.successful
        assert words in result.reason.lower(), result.reason


def test_idim_iv_record_is_the_recorder_and_an_interrupt_closes_its_bag(
    robot, observer, tmp_path: Path, mortal: tuple[Path, str]
) -> None:
    configuration, topic = mortal
    out = tmp_path / "out"
    command = [str(Path(sys.executable).parent / "idim-iv"), "record"]
    process = Process(
        [*command, "--config", str(configuration), "--out", str(out)], tmp_path, "recorder"
    )
    observer.follow(process)
    robot.begin(topics=[{"name": topic}], count=100).run()
    observer.received(100, topic)
    assert process.finish() == 0
    observer.forget("recorder")
    assert np.array_equal(numbers(only_bag(out), topic), np.arange(100.0))


JOINTS = [f"joint_{k}" for k in range(1, 8)]


@pytest.fixture
def seven_joints(robot_file: Callable[[str], Path]) -> Path:
    return robot_file(
        f"robot:\n  joints: [{', '.join(JOINTS)}]\nsignals:\n  reference: /joint_reference\n"
    )


@pytest.mark.load
@pytest.mark.parametrize(
    ("topics", "seconds", "rate", "most"),
    [(["/joint_states", "/joint_reference"], 60, 1000, 0.25), (["/joint_states"], 20, 10_000, 0.5)],
    ids=["a minute of states and references at 1 kHz", "20 s of states at 10 kHz"],
)
def test_seven_joints_without_loss(
    mortal_recorder, robot, observer, bags: Path, seven_joints, topics, seconds, rate, most
) -> None:
    """`most`: the share of a core that the recorder may take."""
    process = mortal_recorder(configuration=str(seven_joints), status_period=1.0)
    count = seconds * rate
    published = [{"name": name, "joints": JOINTS, "depth": 1000} for name in topics]
    robot.begin(count=count, rate=float(rate), pace=True, topics=published)
    observer.call("start")
    before = process.cpu()
    robot.run()
    share = (process.cpu() - before) / seconds
    assert robot.seconds < 1.05 * seconds, "the publisher could not keep up: is the machine idle?"
    for topic in topics:
        observer.received(count, topic)
        assert observer.topic(topic).lost == 0
    observer.call("stop")
    for topic in topics:
        assert np.array_equal(numbers(only_bag(bags), topic), np.arange(float(count)))
    print(f"processor time: {100 * share:.1f} % of one core, publisher {robot.seconds:.1f} s")
    assert share <= most


def publish(observer, topics: dict, count: int) -> None:
    """Publish so many messages on each topic once the recorder has subscribed."""
    publishers = {
        name: observer.node.create_publisher(kind, name, 100) for name, kind in topics.items()
    }
    observer.until(
        lambda: all(publisher.get_subscription_count() for publisher in publishers.values()),
        "subscriptions",
    )
    for _ in range(count):
        for name, publisher in publishers.items():
            publisher.publish(topics[name]())
    for name in topics:
        observer.received(count, name)
    for publisher in publishers.values():
        observer.node.destroy_publisher(publisher)


def content(bag: Path) -> dict[str, tuple[str, int]]:
    with AnyReader([bag]) as reader:
        for connection, _, raw in reader.messages():
            reader.deserialize(raw, connection.msgtype)
        return {c.topic: (c.msgtype, c.msgcount) for c in reader.connections}


def test_topics_of_a_list_and_of_an_expression_are_recorded_as_they_are(
    recorder, observer, bags: Path
) -> None:
    recorder(
        extra_topics=["/tool/wrench", "~/status"], extra_topics_regex="^/drive_[0-9]/", record=True
    )
    topics = {"/tool/wrench": WrenchStamped, "/drive_1/temperature": Temperature}
    publish(observer, topics, 20)
    observer.call("stop")
    recorded = content(only_bag(bags))
    assert recorded["/tool/wrench"] == ("geometry_msgs/msg/WrenchStamped", 20)
    assert recorded["/drive_1/temperature"] == ("sensor_msgs/msg/Temperature", 20)
    # A type that no library knows: its definition comes from its package.
    kind, count = recorded[f"/{observer.name}/status"]
    assert kind == "idim_iv_interfaces/msg/RecorderStatus"
    assert count > 0


def test_a_topic_whose_package_is_not_installed_is_named_once(
    mortal_recorder, observer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A package of the same name without messages hides the real one from the recorder."""
    hidden = tmp_path / "hidden" / "nav_msgs"
    hidden.mkdir(parents=True)
    (hidden / "__init__.py").touch()
    monkeypatch.setenv("PYTHONPATH", f"{hidden.parent}:{os.environ.get('PYTHONPATH', '')}")
    odometry = observer.node.create_publisher(Odometry, "/odometry", 10)
    process = mortal_recorder(extra_topics="['/odometry']", extra_topics_regex="odom|never")
    words = "whose package nav_msgs is not installed here (apt install ros-jazzy-nav-msgs)"
    observer.diagnosed("/odometry", words, 2)
    observer.next_status()
    observer.next_status()
    assert process.errors.read_text().count(words) == 1
    observer.node.destroy_publisher(odometry)
