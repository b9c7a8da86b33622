"""At what level a topic is reported, with a clock that the test sets."""

from types import SimpleNamespace

import numpy as np
import pytest

from idim_iv_interfaces.msg import TopicStatus
from idim_iv_ros.nodes.recorder.report import topic_diagnosis
from idim_iv_ros.nodes.recorder.topic_monitor import MonitorLimits, Received, TopicMonitor

OK, WARN, ERROR = 0, 1, 2


class Clock:
    now = 50.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


def heard(clock: Clock, period: float, count: int = 20) -> SimpleNamespace:
    """A topic with messages that came at a steady period, s, the last one now."""
    sent = np.arange(count) * round(1e9 * period)
    monitor = TopicMonitor(None, False, clock)
    batch = Received("/states", [b""] * count, sent + 1000, sent, np.arange(count))
    monitor.add(batch, MonitorLimits())
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
    fast, slow = heard(clock, 0.002), heard(clock, 0.2)
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


def test_latched_topics_are_never_silent(clock: Clock) -> None:
    topic = heard(clock, 0.002)
    topic.channel.latched = True
    clock.now += 1000.0
    assert diagnosed(topic)[0] == OK


@pytest.mark.parametrize("what", ["lost", "late", "malformed", "backward", "gaps"])
def test_recent_incidents_are_warnings(clock: Clock, what: str) -> None:
    level, sentence = diagnosed(heard(clock, 0.002), **{what: 3})
    assert (level, sentence[:2]) == (WARN, "3 ")


def test_notes_and_several_publishers_are_warnings(clock: Clock) -> None:
    topic = heard(clock, 0.002)
    topic.note, topic.publishers = "subscribed anew", 2
    level, sentence = diagnosed(topic)
    assert level == WARN
    assert sentence.startswith("subscribed anew; 2 publishers")
