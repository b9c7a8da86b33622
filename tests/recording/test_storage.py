"""Storage presets: what a file is compressed with, and that every reader opens it."""

from pathlib import Path

import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from idim_iv_ros.recording.writing.growing_bag import GrowingBag, SplitLimits
from idim_iv_ros.recording.writing.write import PRESETS, TopicChannel
from tests.recording.bag_writer import STORE, joint_state

TOPIC = TopicChannel("/joint_states", "sensor_msgs/msg/JointState")


@pytest.mark.parametrize(
    ("preset", "compression"),
    [("default", "zstd"), ("none", ""), ("fast", "lz4"), ("small", "zstd")],
)
def test_a_preset_decides_how_chunks_are_compressed(tmp_path: Path, preset, compression) -> None:
    bag = GrowingBag(tmp_path / "bag", SplitLimits(), topics=[TOPIC], storage=PRESETS[preset])
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


def test_small_has_fewer_chunks_where_much_arrives_at_once(tmp_path: Path) -> None:
    counts = {}
    for preset in ("default", "small"):
        bag = GrowingBag(tmp_path / preset, SplitLimits(), topics=[TOPIC], storage=PRESETS[preset])
        bag.add([(k, TOPIC.name, bytes(1000), k, k) for k in range(8000)])
        bag.close()
        (file,) = (tmp_path / preset).glob("*.mcap")
        with file.open("rb") as stream:
            counts[preset] = len(make_reader(stream).get_summary().chunk_indexes)
    assert counts == {"default": 8, "small": 2}
