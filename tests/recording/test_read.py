"""Recordings as drivers leave them."""

from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin

from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.recording.read import read_recordings
from idim_iv_ros.recording.recording import Recording
from idim_iv_ros.recording.writing.write import JointTopic, write_bag
from tests.recording.bag_writer import float_array, joint_state, steady, write


def read(bag: Path, joints=("a", "b"), **keywords) -> Recording:
    return read_recordings([bag], joints=joints, **keywords)[0]


def notes(recording: Recording) -> str:
    return "; ".join(f"{note.topic} {note.what} {note.count}" for note in recording.notes)


def assert_values_tell_joint_and_time(recording: Recording) -> None:
    time = recording.start + np.arange(recording.samples) / recording.rate
    good = ~recording.position.invented
    expected = time[:, None] + 10.0 * np.arange(recording.position.values.shape[1])
    np.testing.assert_allclose(recording.position.values[good], expected[good], atol=1e-8)


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_folder_and_lone_file_hold_the_same(tmp_path: Path, storage) -> None:
    folder = write(tmp_path / "bag", steady(), storage)
    (file,) = [f for f in folder.iterdir() if f.suffix in (".mcap", ".db3")]
    (folder / "metadata.yaml").rename(tmp_path / "metadata.yaml")
    lone = read(file)
    (tmp_path / "metadata.yaml").rename(folder / "metadata.yaml")
    whole = read(folder)
    np.testing.assert_array_equal(lone.position.values, whole.position.values)
    assert whole.rate == 100.0
    assert whole.samples == 200
    assert_values_tell_joint_and_time(whole)


def test_joint_order_may_change_between_messages(tmp_path: Path) -> None:
    messages = steady(100)
    messages += [
        ("/joint_states", 6.0 + k / 100, joint_state(2.0 + k / 100, names=("b", "c", "a")))
        for k in range(100)
    ]
    recording = read(write(tmp_path / "bag", messages))
    assert_values_tell_joint_and_time(recording)
    assert "layouts" in notes(recording)
    assert not recording.position.invented.any()


def test_nan_effort_is_marked_and_bridged(tmp_path: Path) -> None:
    messages = steady()
    messages[50] = ("/joint_states", 6.5, joint_state(1.5, effort=[np.nan, 3.0]))
    recording = read(write(tmp_path / "bag", messages))
    assert np.isfinite(recording.effort.values).all()
    assert recording.effort.values[50, 0] == pytest.approx(2.5)
    assert "missing or NaN 1" in notes(recording)


def test_effort_on_a_topic_without_header_uses_arrival_and_says_so(tmp_path: Path) -> None:
    messages = steady()
    messages += [("/effort", 1.0 + k / 50, float_array([k, 2.0 * k])) for k in range(100)]
    messages.sort(key=lambda message: message[1])
    recording = read(write(tmp_path / "bag", messages), effort="/effort")
    clocks = {clock.topic: clock.source for clock in recording.clocks}
    assert clocks == {"/joint_states": "header", "/effort": "arrival"}
    assert "different clocks" in notes(recording)
    np.testing.assert_allclose(recording.effort.values[10], [5.0, 10.0], atol=1e-6)


def test_an_array_of_references_holds_positions_and_no_velocities(tmp_path: Path) -> None:
    messages = steady() + [("/wanted", 1.0 + k / 50, float_array([k, 2.0 * k])) for k in range(100)]
    recording = read(write(tmp_path / "bag", messages), reference="/wanted")
    np.testing.assert_allclose(recording.position_reference.values[10], [5.0, 10.0], atol=1e-6)
    assert recording.velocity_reference is None


def test_array_of_another_length_is_refused(tmp_path: Path) -> None:
    messages = steady() + [("/effort", 1.0 + k / 50, float_array([1.0])) for k in range(100)]
    with pytest.raises(DataError, match=r"1 numbers .* 2 joints"):
        read(write(tmp_path / "bag", messages), effort="/effort")


def test_repeated_and_late_messages_are_put_in_order(tmp_path: Path) -> None:
    messages = steady()
    messages[20], messages[21] = messages[21], messages[20]
    messages.insert(40, messages[39])
    recording = read(write(tmp_path / "bag", messages))
    assert_values_tell_joint_and_time(recording)
    assert recording.clocks[0].repeated == 1
    assert recording.clocks[0].backward == 1
    assert "out of order" in notes(recording)


def test_time_that_runs_backward_is_refused(tmp_path: Path) -> None:
    stamps = [3.0 - k / 100 for k in range(150)] + [3.0 + k / 100 for k in range(150)]
    messages = [("/joint_states", 1.0 + k / 100, joint_state(s)) for k, s in enumerate(stamps)]
    with pytest.raises(DataError, match="time goes backward"):
        read(write(tmp_path / "bag", messages))


def test_jittered_stamps_are_interpolated_on_the_grid(tmp_path: Path) -> None:
    stamps = 1.0 + np.arange(500) / 100 + np.random.default_rng(0).uniform(-2e-3, 2e-3, 500)
    messages = [("/joint_states", float(s), joint_state(float(s))) for s in stamps]
    recording = read(write(tmp_path / "bag", messages))
    assert_values_tell_joint_and_time(recording)
    assert recording.clocks[0].jitter == pytest.approx(0.0016, rel=0.2)
    assert abs(recording.start + (recording.samples - 1) / recording.rate - stamps[-1]) < 0.011


def test_rate_that_is_no_whole_number_does_not_drift(tmp_path: Path) -> None:
    rate = 299.8
    messages = [("/joint_states", 1.0 + k / rate, joint_state(1.0 + k / rate)) for k in range(3000)]
    recording = read(write(tmp_path / "bag", messages))
    assert recording.rate == pytest.approx(rate, rel=1e-6)
    assert_values_tell_joint_and_time(recording)


def test_written_bag_is_read_bit_for_bit_here_and_by_rosbags(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    time = 3.0 + np.arange(1000) / 1000.0
    values = random.normal(size=(1000, 2))
    topics = [
        JointTopic("/joint_states", ["a", "b"], time, values, 2 * values, 3 * values),
        JointTopic("/joint_reference", ["a", "b"], time, 4 * values),
    ]
    write_bag(tmp_path / "bag.mcap", topics, robot_description="<robot/>")
    recording = read(tmp_path / "bag.mcap", reference="/joint_reference")
    np.testing.assert_array_equal(recording.position.values, values)
    np.testing.assert_array_equal(recording.velocity.values, 2 * values)
    np.testing.assert_array_equal(recording.effort.values, 3 * values)
    np.testing.assert_array_equal(recording.position_reference.values, 4 * values)
    assert recording.robot_description == "<robot/>"
    assert not recording.position.values.flags.writeable
    with AnyReader([tmp_path / "bag.mcap"]) as reader:
        said = [(c.topic, reader.deserialize(raw, c.msgtype)) for c, _, raw in reader.messages()]
    states = [message for topic, message in said if topic == "/joint_states"]
    np.testing.assert_array_equal([message.position for message in states], values)
    np.testing.assert_array_equal([message.effort for message in states], 3 * values)
    references = [message for topic, message in said if topic == "/joint_reference"]
    assert len(references) == 1000 and all(len(message.effort) == 0 for message in references)
    assert [message.data for topic, message in said if "description" in topic] == ["<robot/>"]


@pytest.mark.parametrize(
    ("make", "keywords", "words"),
    [
        (lambda: [], {}, "empty"),
        (steady, {"joint_states": "/states"}, "no topic /states; joint states are on /joint_s"),
        (steady, {"reference": "/joint_reference"}, "no topic /joint_reference"),
        (steady, {"joints": ("a", "elbow")}, "never holds joint elbow; it holds a, b"),
        (lambda: steady(effort=[]), {}, "effort of a on /joint_states is empty or NaN"),
        (lambda: steady(effort=[np.nan] * 2), {}, "effort of a on /joint_states is empty or NaN"),
        (lambda: steady(effort=[1.0, 0.0]), {}, "effort of b .* is zero throughout"),
        (lambda: steady(10), {}, "10 samples are too few"),
        (lambda: steady(1), {}, "1 messages"),
    ],
)
def test_unusable_recording_is_one_line_with_the_file(tmp_path, make, keywords, words) -> None:
    bag = write(tmp_path / "bag", make())
    with pytest.raises(DataError, match=words) as caught:
        read(bag, **keywords)
    assert str(caught.value).startswith(str(bag))


@pytest.mark.parametrize(
    ("name", "content", "error", "words"),
    [
        ("none.mcap", None, UsageError, "no such file"),
        ("table.csv", "1,2", DataError, "idim-iv import"),
        ("text.mcap", "not a bag", DataError, "not an MCAP file"),
        ("empty.mcap", "", DataError, "the file is empty"),
        ("text.db3", "not a bag", DataError, "not a rosbag2 database"),
        (".", None, DataError, r"no \.mcap or \.db3"),
    ],
)
def test_missing_file_and_foreign_file_are_named(tmp_path, name, content, error, words) -> None:
    if content is not None:
        (tmp_path / name).write_text(content)
    with pytest.raises(error, match=words):
        read(tmp_path / name)
