"""Recordings of a session one after the other, and a long one in segments."""

from itertools import permutations
from pathlib import Path

import numpy as np
import pytest

from idim_iv_ros.recording.bags.folder import Bag
from idim_iv_ros.recording.read import read_bag, read_segments
from idim_iv_ros.recording.recording import (
    LONGEST_PAUSE,
    Recording,
    Signal,
    in_recordings,
    session_of,
)
from idim_iv_ros.recording.request import Request
from tests.recording.bag_writer import NAMES, steady, write

RATE = 100.0


def recording(name: str, start: float, seconds: float = 10.0, rate: float = RATE) -> Recording:
    values = np.zeros((round(seconds * rate), 1))
    signal = Signal(values, np.zeros(values.shape, dtype=bool), "made up")
    return Recording(
        path=Path("runs") / name,
        joints=("a",),
        rate=rate,
        start=start,
        position=signal,
        effort=signal,
        velocity=None,
        position_reference=None,
        velocity_reference=None,
        clocks=(),
        notes=(),
        robot_description=None,
    )


@pytest.mark.parametrize("starts", [(5.0, 60.0, 300.0), (0.0, 4.0, 7.0), (1.7e9, 1.7e9 + 1.0, 3.0)])
def test_recordings_follow_their_first_stamps_whatever_the_order_given(starts) -> None:
    recordings = [recording(f"{start:.0f}.mcap", start) for start in starts]
    sessions = [session_of(order) for order in permutations(recordings)]
    assert len({(session.parts, session.sentences) for session in sessions}) == 1
    assert [ordered.start for ordered in sessions[0].recordings] == sorted(starts)


MANY = tuple(np.random.default_rng(1).uniform(0.0, 200.0, 40).tolist())


@pytest.mark.parametrize("starts", [(0.0,) * 3, (0.0, 3.0, 20.0), (0.0, 10.0, 12.0), MANY])
def test_time_of_the_session_increases_from_sample_to_sample(starts) -> None:
    session = session_of([recording(f"{k}", start) for k, start in enumerate(starts)])
    time = np.concatenate([part.start + np.arange(1000) / RATE for part in session.parts])
    assert np.diff(time).min() == pytest.approx(1.0 / RATE)


@pytest.mark.parametrize(
    ("stamps", "expected"),
    [
        ([("b", 0.0, 10.0), ("a", 0.0, 10.0), ("c", 0.0, 10.0)], [0.0, 10.0, 20.0]),
        ([("a", 0.0, 10.0), ("b", 130.0, 10.0), ("c", 1.7e9, 10.0)], [0.0, 130.0, 3740.0]),
        # The second lies within the first one; the third starts 5 s after that ends.
        ([("a", 0.0, 30.0), ("b", 2.0, 4.0), ("c", 35.0, 10.0)], [0.0, 30.0, 39.0]),
    ],
)
def test_pauses_keep_their_length_up_to_an_hour_and_equal_stamps_their_order(stamps, expected):
    session = session_of([recording(*described) for described in stamps])
    assert [part.bag for part in session.parts] == [name for name, _, _ in stamps]
    assert [part.start for part in session.parts] == pytest.approx(expected)
    shortened = [text for text in session.sentences if "3600 s at most" in text]
    assert len(shortened) == (expected[-1] > LONGEST_PAUSE)


def test_overlapping_stamps_are_named_and_one_recording_needs_no_words() -> None:
    order, overlap = session_of([recording("b.mcap", 4.0), recording("a.mcap", 0.0)]).sentences
    assert order.index("a.mcap") < order.index("b.mcap") and "b.mcap" in overlap
    assert session_of([recording("a", 7.0)]).sentences == ()


def test_a_time_of_the_session_is_told_in_the_time_of_its_recording() -> None:
    parts = session_of([recording("run1", 0.0), recording("run2", 100.0)]).parts
    assert in_recordings(parts, 101.5, 109.0) == "1.5 to 9 s of run2"
    assert in_recordings(parts, 8.0, 102.0) == "8 s of run1 to 2 s of run2"
    assert in_recordings(parts, 2.0, 100.0) == "2 to 9.99 s of run1"


def test_recordings_of_the_same_name_are_told_by_their_folder() -> None:
    one, two = recording("a/bag", 0.0), recording("b/bag", 0.0)
    assert [part.bag for part in session_of([one, two]).parts] == ["runs/a/bag", "runs/b/bag"]


REQUEST = Request(list(NAMES), "/joint_states", "/joint_states", None)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """25.8 s at 100 Hz."""
    return write(tmp_path_factory.mktemp("bags") / "long", steady(2580))


def test_segments_hold_every_sample_once(bag: Path) -> None:
    whole = read_bag(Bag(bag), REQUEST)
    parts = list(read_segments(Bag(bag), REQUEST, seconds=5.0))
    # The last takes what remains: from half a segment to one and a half.
    assert [round(part.duration + 0.01, 6) for part in parts] == [5.0, 5.0, 5.0, 5.0, 5.8]
    position = np.vstack([part.position.values for part in parts])
    assert np.array_equal(position, whole.position.values)
    starts = [part.start for part in parts]
    np.testing.assert_allclose(starts, whole.start + 5.0 * np.arange(5), atol=1e-9)


def test_a_topic_that_ends_early_holds_nothing_back(tmp_path: Path) -> None:
    messages = steady(3000)
    reference = [("/ref", when, message) for _, when, message in messages[:900]]
    path = write(tmp_path / "b", sorted(messages + reference, key=lambda message: message[1]))
    request = Request(list(NAMES), "/joint_states", "/joint_states", "/ref")
    first, second, *others = read_segments(Bag(path), request, seconds=5.0)
    assert first.duration == pytest.approx(4.99)
    assert second.position_reference.invented[410:].all()
    assert len(others) == 4
    assert all("/ref" in str(other) for other in others)
