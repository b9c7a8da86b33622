"""What one bad byte, a torn end or an unreadable message costs, and what is said of it."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.rosbag2 import StoragePlugin

from idim_iv_ros.errors import DataError
from idim_iv_ros.recording.bags.joint_message_type import JOINT_STATE
from idim_iv_ros.recording.read import read_recordings
from idim_iv_ros.recording.recording import Recording
from idim_iv_ros.recording.writing.growing_bag import GrowingBag
from idim_iv_ros.recording.writing.write import JointTopic, TopicChannel, serialised, write_bag
from tests.recording import bag_writer

JOINTS = ["a", "b"]
RATE = 200
SECONDS = 5
SAMPLES = RATE * SECONDS
TIME = 100.0 + np.arange(SAMPLES) / RATE
VALUES = np.random.default_rng(0).normal(size=(SAMPLES, 2)).cumsum(axis=0) * 1e-3
TOPICS = [
    JointTopic("/joint_states", JOINTS, TIME, VALUES, None, 1.0 + VALUES),
    JointTopic("/joint_reference", JOINTS, TIME, VALUES),
]


def _by_write_bag(folder: Path) -> Path:
    write_bag(folder / "bag.mcap", TOPICS, robot_description="<robot/>" * 500)
    return folder / "bag.mcap"


def _by_the_recorder(folder: Path) -> Path:
    """As the recorder writes when nothing can be committed for a while: all at once."""
    bag = GrowingBag(folder / "recorded")
    stamps = np.round(TIME * 1e9).astype(np.int64)
    messages = []
    for topic in TOPICS:
        bag.describe(TopicChannel(topic.name, JOINT_STATE))
        for k, (stamp, raw) in enumerate(zip(stamps, serialised(topic, stamps), strict=True)):
            messages.append((int(stamp), topic.name, raw.tobytes(), int(stamp), k))
    bag.add(sorted(messages, key=lambda message: message[0]))
    bag.close()
    return folder / "recorded" / "recorded_0.mcap"


@pytest.mark.parametrize("make", [_by_write_bag, _by_the_recorder])
def test_one_bad_byte_costs_a_second_at_most(tmp_path: Path, make: Callable) -> None:
    content = make(tmp_path).read_bytes()
    random = np.random.default_rng(1)
    places = {*range(60), *range(len(content) - 40, len(content))}
    places |= set(random.integers(0, len(content), 50).tolist())
    worst = 0
    for place in places:
        damaged = bytearray(content)
        damaged[place] ^= 1 << int(random.integers(8))
        recording = _read(tmp_path / "damaged.mcap", bytes(damaged))
        lost = SAMPLES - (int((~recording.effort.invented[:, 0]).sum()))
        assert lost <= RATE, (place, lost, recording.notes)
        good = ~recording.position.invented
        if recording.samples == SAMPLES:
            np.testing.assert_allclose(recording.position.values[good], VALUES[good], atol=1e-12)
        worst = max(worst, lost)
    assert worst == RATE  # a byte of the messages themselves costs their second


def test_every_byte_of_the_records_between_chunks_may_be_wrong(tmp_path: Path) -> None:
    """Heads and indices, where a length leads astray: found by writing each byte anew."""
    content = _by_write_bag(tmp_path).read_bytes()
    chunk = content.index(b"zstd", len(content) // 2) - 41
    size = 9 + int.from_bytes(content[chunk + 1 : chunk + 9], "little")
    for place in (*range(chunk, chunk + 60), *range(chunk + size, chunk + size + 40)):
        for value in (0, 0xFF):
            if content[place] == value:
                continue
            damaged = bytearray(content)
            damaged[place] = value
            recording = _read(tmp_path / "damaged.mcap", bytes(damaged))
            lost = SAMPLES - int((~recording.effort.invented[:, 0]).sum())
            assert lost <= RATE, (place, value)


def test_a_folder_tells_by_its_metadata_what_a_torn_file_lost(tmp_path: Path) -> None:
    path = _by_the_recorder(tmp_path)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    (recording,) = read_recordings([path.parent], joints=JOINTS)
    (note,) = [note for note in recording.notes if note.limits]
    saved = int((~recording.effort.invented[:, 0]).sum())
    assert f"on /joint_states were saved, {SAMPLES - saved} are lost" in note.what


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4])
def test_what_came_before_the_tear_is_saved_from_a_single_long_chunk(tmp_path, compression) -> None:
    values = np.random.default_rng(3).normal(size=(12 * RATE, 2)).cumsum(axis=0) * 1e-3
    content = _foreign(tmp_path, values, chunk_size=1 << 30, compression=compression)
    recording = _read(tmp_path / "torn.mcap", content[: int(0.7 * len(content))], reference=False)
    assert recording.samples > 0.4 * len(values)
    np.testing.assert_array_equal(recording.position.values, values[: recording.samples])


def _foreign(folder: Path, values: np.ndarray, **settings) -> bytes:
    """As another writer might: no index of messages, no checksum."""
    path = folder / "foreign.mcap"
    stamps = np.round((100.0 + np.arange(len(values)) / RATE) * 1e9).astype(np.int64)
    topic = JointTopic("/joint_states", JOINTS, stamps * 1e-9, values, None, 1.0 + values)
    payload = serialised(topic, stamps)
    with path.open("wb") as stream:
        writer = Writer(stream, index_types=IndexType.NONE, enable_crcs=False, **settings)
        writer.start()
        channel = TopicChannel("/joint_states", JOINT_STATE).register(writer)
        for k, stamp in enumerate(stamps):
            writer.add_message(channel, int(stamp), payload[k].tobytes(), int(stamp), k)
        writer.finish()
    return path.read_bytes()


def test_a_bag_torn_before_its_first_message_is_not_called_empty(tmp_path: Path) -> None:
    content = _by_write_bag(tmp_path).read_bytes()
    with pytest.raises(DataError) as caught:
        _read(tmp_path / "torn.mcap", content[:120])
    assert "empty" not in str(caught.value)
    assert ": 0 messages on /joint_states" in str(caught.value)


def test_a_bad_page_of_a_database_costs_its_rows_only(tmp_path: Path) -> None:
    folder = bag_writer.write(tmp_path / "bag", bag_writer.steady(2000), StoragePlugin.SQLITE3)
    (path,) = folder.glob("*.db3")
    content = bytearray(path.read_bytes())
    middle = len(content) // 2 // 4096 * 4096
    content[middle : middle + 4096] = b"\xff" * 4096
    path.write_bytes(bytes(content))
    (recording,) = read_recordings([folder], joints=JOINTS)
    measured = int((~recording.effort.invented[:, 0]).sum())
    assert 1900 < measured < 2000
    (note,) = [note for note in recording.notes if note.limits]
    assert f"on /joint_states were saved, {2000 - measured} are lost" in note.what


def _read(path: Path, content: bytes, *, reference: bool = True) -> Recording:
    path.write_bytes(content)
    topic = "/joint_reference" if reference else None
    return read_recordings([path], joints=JOINTS, reference=topic)[0]
