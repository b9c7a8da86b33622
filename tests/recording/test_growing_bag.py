"""A bag that grows: what a reader finds whenever the recorder is killed, or the disk is full."""

import errno
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader

from idim_iv_ros.recording.writing.growing_bag import GrowingBag, Message
from idim_iv_ros.recording.writing.write import PRESETS, TopicChannel
from tests.recording.bag_writer import STORE, joint_state

TOPIC = TopicChannel("/joint_states", "sensor_msgs/msg/JointState")


def messages(first: int, count: int) -> list[Message]:
    raw = bytes(STORE.serialize_cdr(joint_state(0.5), TOPIC.message_type))
    return [(k, TOPIC.name, raw, k, k) for k in range(first, first + count)]


def full(*_: object) -> int:
    raise OSError(errno.ENOSPC, "No space left on device")


def counts(bag: Path) -> tuple[int, int]:
    """Messages that metadata.yaml promises, and that the files hold."""
    with Reader(bag) as reader:
        return reader.message_count, sum(1 for _ in reader.messages())


@pytest.fixture
def looked(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[tuple[int, int]]:
    """Counts before and after everything that changes what is on disk."""
    seen: list[tuple[int, int]] = []

    def watched(change: Callable) -> Callable:
        def changed(*arguments):
            if (tmp_path / "bag" / "metadata.yaml").exists():
                seen.append(counts(tmp_path / "bag"))
            return change(*arguments)

        return changed

    for name in ("pwrite", "replace", "close"):
        monkeypatch.setattr(os, name, watched(getattr(os, name)))
    return seen


def test_at_no_instant_a_file_holds_more_than_metadata_says(tmp_path: Path, looked) -> None:
    bag = GrowingBag(tmp_path / "bag", topics={TOPIC.name: TOPIC})
    assert counts(bag.folder) == (0, 0)
    for k in range(2):
        bag.add(messages(1 + 10 * k, 10))
        bag.commit()
    bag.add(messages(21, 10))
    bag.split()
    assert counts(bag.folder) == (30, 30)
    bag.add(messages(31, 5))
    bag.close()
    assert len(looked) > 10
    assert all(promised >= stored for promised, stored in looked), looked
    assert counts(bag.folder) == (35, 35)


def test_what_a_full_disk_refuses_is_not_promised(tmp_path, monkeypatch) -> None:
    bag = GrowingBag(tmp_path / "bag", topics={TOPIC.name: TOPIC})
    bag.add(messages(1, 10))
    bag.commit()
    bag.add(messages(11, 10))
    with monkeypatch.context() as patched:
        patched.setattr(os, "pwrite", full)
        with pytest.raises(OSError, match="No space"):
            bag.commit()
    assert counts(bag.folder) == (10, 10)
    bag.commit()
    assert counts(bag.folder) == (20, 20)


def test_a_bag_that_cannot_begin_leaves_nothing(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(os, "pwrite", full)
    with pytest.raises(OSError, match="No space"):
        GrowingBag(tmp_path / "bag", topics={TOPIC.name: TOPIC})
    assert not (tmp_path / "bag").exists()


@pytest.mark.parametrize(
    ("preset", "compression"),
    [("default", "zstd"), ("none", ""), ("fast", "lz4"), ("small", "zstd")],
)
def test_a_preset_decides_how_chunks_are_compressed(tmp_path: Path, preset, compression) -> None:
    bag = GrowingBag(tmp_path / "bag", topics={TOPIC.name: TOPIC}, storage=PRESETS[preset])
    for k in range(3000):
        raw = bytes(STORE.serialize_cdr(joint_state(k / 1000.0), TOPIC.message_type))
        bag.add([(k * 1_000_000, TOPIC.name, raw, k * 1_000_000, k)])
    bag.close()
    (file,) = (tmp_path / "bag").glob("*.mcap")
    with file.open("rb") as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    assert {chunk.compression for chunk in chunks} == {compression}
    with AnyReader([tmp_path / "bag"]) as reader:
        read = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages()]
    assert [message.position[0] for message in read[:3]] == [0.0, 0.001, 0.002]
    assert len(read) == 3000
