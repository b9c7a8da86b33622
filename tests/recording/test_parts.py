"""Several publishers on one topic: an arm and its gripper, or an arm joint by joint."""

from pathlib import Path

import numpy as np
import pytest

from idim_iv_ros.errors import DataError
from idim_iv_ros.recording.read import read_recordings
from idim_iv_ros.recording.recording import Recording
from tests.recording.bag_writer import joint_state, write

ARM = ("a", "b", "c")
SECONDS = 2.0
LATER = 1e-4  # s between two messages of one stamp


def messages(names, rate: float = 100.0, stamped: float = 0.0, arrives: float = 0.0, **fields):
    """Messages of one publisher; `stamped` and `arrives` s after those of the others."""
    stamps = 1.0 + stamped + np.arange(round(SECONDS * rate)) / rate
    return [
        ("/joint_states", 5.0 + stamp + arrives, joint_state(stamp, names=names, **fields))
        for stamp in stamps.tolist()
    ]


def gripper(**keywords):
    return messages(("finger",), position=[0.04], effort=[], **keywords)


def read(folder: Path, *publishers, joints=ARM) -> Recording:
    every = sorted((one for publisher in publishers for one in publisher), key=lambda one: one[1])
    (recording,) = read_recordings([write(folder / "bag", every)], joints=joints)
    return recording


def assert_every_joint_is_at_its_own_time(recording: Recording) -> None:
    """Positions and efforts of the messages tell joint and stamp; see `bag_writer`."""
    time = recording.start + np.arange(recording.samples) / recording.rate
    place = np.array([ARM.index(joint) for joint in recording.joints])
    for signal, expected in (
        (recording.position, time[:, None] + 10.0 * place),
        (recording.effort, 1.0 + time[:, None] + place),
    ):
        good = ~signal.invented
        np.testing.assert_allclose(signal.values[good], expected[good], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("rate", [30.0, 100.0, 500.0])
@pytest.mark.parametrize(
    ("stamped", "arrives"), [(0.0, -LATER), (0.0, LATER), (-0.002, 0.0), (0.002, 0.0)]
)
def test_a_gripper_changes_nothing_of_the_arm(tmp_path, rate, stamped, arrives) -> None:
    alone = read(tmp_path / "alone", messages(ARM))
    other = gripper(rate=rate, stamped=stamped, arrives=arrives)
    recording = read(tmp_path / "both", messages(ARM), other)
    assert recording.rate == 100.0
    assert recording.clocks == alone.clocks
    for name in ("position", "effort"):
        np.testing.assert_array_equal(getattr(recording, name).values, getattr(alone, name).values)
        assert not getattr(recording, name).invented.any()
    (passed,) = [note for note in recording.notes if "other joints" in note.what]
    assert passed.count == round(SECONDS * rate)
    assert not passed.limits


@pytest.mark.parametrize("joints", [ARM, ("c", "a", "b")])
@pytest.mark.parametrize(
    ("stamped", "arrives"), [(0.0, -LATER), (0.0, LATER), (-0.003, 0.0), (0.003, 0.0)]
)
def test_an_arm_in_two_messages_is_one_recording(tmp_path, joints, stamped, arrives) -> None:
    last = messages(("c",), stamped=stamped, arrives=arrives)
    recording = read(tmp_path, messages(("a", "b")), last, joints=joints)
    assert recording.rate == 100.0
    assert recording.samples >= 199
    assert not recording.position.invented.any()
    assert not recording.effort.invented.any()
    assert_every_joint_is_at_its_own_time(recording)
    assert any("2 messages" in note.what for note in recording.notes)


@pytest.mark.parametrize("rates", [(100.0, 250.0), (250.0, 100.0)])
def test_the_slower_message_gives_the_rate(tmp_path: Path, rates: tuple[float, float]) -> None:
    first, last = messages(("a", "b"), rates[0]), messages(("c",), rates[1], stamped=0.001)
    recording = read(tmp_path, first, last)
    assert recording.rate == 100.0
    assert not recording.position.invented.any()
    assert_every_joint_is_at_its_own_time(recording)
    assert {round(clock.rate) for clock in recording.clocks} == {100, 250}


def test_what_one_message_lost_is_missing_of_its_joints_only(tmp_path: Path) -> None:
    lossy = messages(("c",), arrives=LATER)
    del lossy[50:60]
    recording = read(tmp_path, messages(("a", "b")), lossy)
    np.testing.assert_array_equal(recording.position.invented.sum(axis=0), [0, 0, 10])
    assert_every_joint_is_at_its_own_time(recording)


@pytest.mark.parametrize("efforts_first", [False, True])
def test_positions_and_efforts_of_one_stamp_belong_together(tmp_path, efforts_first) -> None:
    arrives = -LATER if efforts_first else LATER
    positions, efforts = messages(ARM, effort=[]), messages(ARM, position=[], arrives=arrives)
    recording = read(tmp_path, positions, efforts)
    assert recording.rate == 100.0
    assert not recording.effort.invented.any()
    assert recording.clocks[0].repeated == 0
    assert_every_joint_is_at_its_own_time(recording)


def test_a_topic_of_the_gripper_alone_is_refused_with_what_it_holds(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"joint a; .* finger"):
        read(tmp_path, gripper())


def test_a_joint_whose_message_has_no_effort_is_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"effort of c .* is empty"):
        read(tmp_path, messages(("a", "b")), messages(("c",), stamped=0.003, effort=[]))
