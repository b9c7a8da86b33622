"""Encoders behind the gears: their topic is read beside the others, and may lack joints."""

from pathlib import Path

import numpy as np
import pytest

from idim_iv_ros import DataError, import_table, read_recordings, write_bag
from idim_iv_ros.recording.writing.write import JointTopic

JOINTS = ["a", "b"]
TIME = np.arange(2000) / 500.0


def motion(time: np.ndarray) -> np.ndarray:
    return np.column_stack([np.sin(2.0 * time), 0.4 * np.cos(3.0 * time)])


def states() -> JointTopic:
    effort = motion(TIME) + 1.0
    return JointTopic("/joint_states", JOINTS, TIME, position=motion(TIME), effort=effort)


def written(folder: Path, *topics: JointTopic) -> Path:
    bag = folder / "bag.mcap"
    write_bag(bag, [states(), *topics])
    return bag


def read(bag: Path):
    (recording,) = read_recordings([bag], joints=JOINTS, link_states="/link_states")
    return recording


def test_positions_at_another_rate_are_on_the_common_grid(tmp_path: Path) -> None:
    time = np.arange(0.0003, 4.01, 1.0 / 800.0)
    link = JointTopic("/link_states", JOINTS, time, position=motion(time))
    recording = read(written(tmp_path, link))
    assert recording.link_position.values.shape == recording.position.values.shape
    inside = ~recording.link_position.invented.any(axis=1)
    assert inside.mean() > 0.99
    inside[0] = False  # before its first stamp
    difference = recording.link_position.values - recording.position.values
    # Linear between stamps 1.25 ms apart, of accelerations up to 4 rad/s².
    assert np.abs(difference[inside]).max() < 4.0 * (1.25e-3) ** 2 / 8.0 * 1.05


def test_a_joint_without_encoder_is_invented_throughout(tmp_path: Path) -> None:
    link = JointTopic("/link_states", ["b"], TIME, position=motion(TIME)[:, 1:])
    recording = read(written(tmp_path, link))
    assert recording.link_position.invented[:, 0].all()
    assert not recording.link_position.invented[:, 1].any()
    behind, before = recording.link_position.values[:, 1], recording.position.values[:, 1]
    assert np.allclose(behind, before, rtol=0.0, atol=1e-12)
    assert not any("missing" in note.sentence for note in recording.notes)


@pytest.mark.parametrize(
    ("topics", "words"),
    [
        ([("/link_states", ["c", "d"], TIME)], r"/link_states .* a; .* c, d"),
        ([], "no topic /link_states"),
        ([("/link_states", JOINTS, TIME + 100.0)], "/link_states and /joint_states"),
    ],
    ids=["other joints", "no topic", "another time"],
)
def test_a_topic_that_says_nothing_of_the_joints_is_refused(tmp_path, topics, words) -> None:
    with pytest.raises(DataError, match=words):
        read(written(tmp_path, *(JointTopic(*topic, position=motion(TIME)) for topic in topics)))


def test_a_wrapped_encoder_is_in_the_turn_of_its_motor(tmp_path: Path) -> None:
    behind = motion(TIME) + 2.0 * np.pi
    recording = read(written(tmp_path, JointTopic("/link_states", JOINTS, TIME, position=behind)))
    assert np.allclose(recording.link_position.values, recording.position.values, atol=1e-12)


@pytest.mark.parametrize("samples", [2000, 1999])
def test_import_writes_the_topic_or_refuses_another_length(tmp_path: Path, samples: int) -> None:
    described, out = tmp_path / "map.yaml", tmp_path / "out.mcap"
    link = motion(TIME)[:samples] - 1e-3
    np.savez(tmp_path / "d.npz", q=motion(TIME), tau=motion(TIME) + 1.0, link=link)
    described.write_text(
        "file: d.npz\nrate: 500.0\njoints:\n"
        "  a: {position: 'q[0]', effort: 'tau[0]', link: 'link[0]'}\n"
        "  b: {position: 'q[1]', effort: 'tau[1]', link: 'link[1]'}\n"
    )
    if samples != len(TIME):
        with pytest.raises(DataError, match=r"different lengths .*2000.* 1999"):
            import_table(out, described)
        assert not out.exists()
        return
    assert "link" in import_table(out, described).signals
    recording = read(out)
    assert np.allclose(recording.position.values - recording.link_position.values, 1e-3)
