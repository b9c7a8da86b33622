"""A long bag read in segments holds what the same bag read whole does."""

from pathlib import Path

import numpy as np
import pytest

from idim_iv_ros.recording.bags.folder import Bag
from idim_iv_ros.recording.read import read_bag, read_segments
from idim_iv_ros.recording.request import Request
from tests.recording.bag_writer import NAMES, steady, write

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


def test_a_bag_of_up_to_one_and_a_half_segments_is_read_whole(bag: Path) -> None:
    whole = read_bag(Bag(bag), REQUEST)
    (part,) = read_segments(Bag(bag), REQUEST, seconds=20.0)
    assert np.array_equal(part.position.values, whole.position.values)
    assert part.notes == whole.notes


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
