"""A warning of the recorder fades; totals stay."""

from idim_iv_interfaces.msg import TopicStatus
from idim_iv_ros.nodes.recorder.report import RECENT, RecentCounts


def test_an_incident_is_a_warning_for_a_while() -> None:
    recent = RecentCounts()
    for second in range(60):
        late = 3 if second >= 5 else 0
        rose = recent.since(TopicStatus(received=100 * second, late=late), float(second))
        assert rose.late == (3 if 5 <= second < 5 + RECENT else 0)


def test_what_came_before_the_first_look_counts() -> None:
    recent = RecentCounts()
    assert recent.since(TopicStatus(received=100, gaps=2), 0.0).gaps == 2
    assert recent.since(TopicStatus(received=200, gaps=2), RECENT).gaps == 0


def test_a_new_recording_counts_from_zero() -> None:
    recent = RecentCounts()
    for second in range(20):
        recent.since(TopicStatus(received=100 * second, lost=4), float(second))
    assert recent.since(TopicStatus(received=50, lost=1), 20.0).lost == 1
