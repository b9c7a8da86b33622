"""Topics besides those of the robot's signals are recorded as they are."""

import os
import re
from pathlib import Path

import pytest
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import Temperature

from idim_iv_ros.errors import UsageError
from idim_iv_ros.nodes.settings import RecorderSettings
from tests.ros.processes import only_bag


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
        extra_topics=["/tool/wrench", "~/status"],
        extra_topics_regex="^/drive_[0-9]/",
        record=True,
    )
    topics = {"/tool/wrench": WrenchStamped, "/drive_1/temperature": Temperature}
    publish(observer, topics, 20)
    assert observer.call("stop").success
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


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"extra_topics": ("/a b",)}, "extra_topics: '/a b' is no name of a topic"),
        ({"extra_topics_regex": "("}, "extra_topics_regex: no regular expression"),
    ],
)
def test_wrong_values_are_refused_in_one_line(values, words: str) -> None:
    with pytest.raises(UsageError, match=re.escape(words)):
        RecorderSettings(**values).check()
