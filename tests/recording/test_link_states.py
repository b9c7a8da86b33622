"""Encoders behind the gears: their topic is read beside the others, and may lack joints."""

from pathlib import Path

import numpy as np
import pytest

from idim_iv_ros import DataError, UsageError, import_table, read_recordings, write_bag
from idim_iv_ros.configuration import load_configuration
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


def test_a_topic_of_other_joints_is_refused_with_their_names(tmp_path: Path) -> None:
    link = JointTopic("/link_states", ["c", "d"], TIME, position=motion(TIME))
    with pytest.raises(DataError, match=r"/link_states .* a; .* c, d"):
        read(written(tmp_path, link))


def test_a_topic_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no topic /link_states"):
        read(written(tmp_path))


def test_a_topic_of_another_time_is_refused(tmp_path: Path) -> None:
    link = JointTopic("/link_states", JOINTS, TIME + 100.0, position=motion(TIME))
    with pytest.raises(DataError, match="/link_states and /joint_states"):
        read(written(tmp_path, link))


def test_a_wrapped_encoder_is_in_the_turn_of_its_motor(tmp_path: Path) -> None:
    behind = motion(TIME) + 2.0 * np.pi
    recording = read(written(tmp_path, JointTopic("/link_states", JOINTS, TIME, position=behind)))
    assert np.allclose(recording.link_position.values, recording.position.values, atol=1e-12)


def test_import_writes_the_topic(tmp_path: Path) -> None:
    np.savez(tmp_path / "d.npz", q=motion(TIME), tau=motion(TIME) + 1.0, link=motion(TIME) - 1e-3)
    table = tmp_path / "d.npz"
    summary = import_table(
        tmp_path / "out.mcap",
        joints=JOINTS,
        rate=500.0,
        position=f"{table}:q",
        effort=f"{table}:tau",
        link=f"{table}:link",
    )
    assert "link" in summary.signals
    recording = read(tmp_path / "out.mcap")
    assert np.allclose(recording.position.values - recording.link_position.values, 1e-3)


def test_import_refuses_another_length(tmp_path: Path) -> None:
    np.savez(tmp_path / "d.npz", q=motion(TIME), tau=motion(TIME), link=motion(TIME)[:-1])
    table = tmp_path / "d.npz"
    with pytest.raises(DataError, match="1999 samples, but 2000"):
        import_table(
            tmp_path / "out.mcap",
            joints=JOINTS,
            rate=500.0,
            position=f"{table}:q",
            effort=f"{table}:tau",
            link=f"{table}:link",
        )
    assert not (tmp_path / "out.mcap").exists()


def test_a_topic_with_another_meaning_is_refused(tmp_path: Path) -> None:
    (tmp_path / "r.urdf").write_text("<robot name='r'><link name='a'/></robot>")
    path = tmp_path / "r.yaml"
    path.write_text(
        "robot:\n  urdf: r.urdf\n  joints: [a]\nsignals:\n  link_states: /joint_states\n"
    )
    with pytest.raises(UsageError, match="link_states is /joint_states"):
        load_configuration(path)
