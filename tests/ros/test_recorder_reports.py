"""What the recorder says of a topic: of the joints in its messages, and at what level."""

from collections.abc import Sequence
from types import SimpleNamespace

import numpy as np
import pytest

from idim_iv_interfaces.msg import TopicStatus
from idim_iv_ros.nodes.recorder.report import RECENT, RecentCounts, topic_diagnosis
from idim_iv_ros.nodes.recorder.topic_monitor import (
    JointContent,
    Received,
    TopicMonitor,
)
from idim_iv_ros.nodes.settings import RecorderSettings
from idim_iv_ros.recording.bags.definitions import JOINT_STATE
from tests.recording.bag_writer import STORE, joint_state

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


class Clock:
    """Monotonic time, s."""

    now = 50.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


def topic_of_period(clock: Clock, period: float, count: int = 20) -> SimpleNamespace:
    """A topic with messages that came at a steady period, s, the last one now."""
    sent = np.arange(count) * round(1e9 * period)
    monitor = TopicMonitor(None, False, clock)
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


def test_silence_is_an_error_after_a_second_or_twenty_periods(clock: Clock) -> None:
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
def test_recent_incidents_are_warnings(clock: Clock, what: str) -> None:
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
