"""Whatever the bytes of a bag are: what is whole is read, the rest is one line."""

from pathlib import Path

import numpy as np
import pytest

from idim_iv_ros.errors import IdimError
from idim_iv_ros.recording import JointTopic, read_recordings, write_bag


@pytest.fixture(scope="module")
def content(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("bag") / "bag.mcap"
    values = np.random.default_rng(0).normal(size=(40_000, 2))
    time = np.arange(40_000) / 1000.0
    write_bag(path, [JointTopic("/joint_states", ["a", "b"], time, values, None, values)])
    return path.read_bytes()


def read(path: Path, content: bytes):
    path.write_bytes(content)
    return read_recordings([path], joints=["a", "b"])[0]


def test_truncated_file_gives_its_whole_chunks_and_says_so(tmp_path: Path, content) -> None:
    recording = read(tmp_path / "bag.mcap", content[: int(0.6 * len(content))])
    assert 10_000 < recording.samples < 30_000
    assert any("ends in the middle" in note.what for note in recording.notes)


@pytest.mark.parametrize("share", np.linspace(0.0, 0.999, 25))
def test_any_truncation_ends_in_a_recording_or_one_line(tmp_path: Path, content, share) -> None:
    outcome(tmp_path, content[: int(share * len(content))])


@pytest.mark.parametrize("seed", range(60))
def test_any_flipped_bytes_end_in_a_recording_or_one_line(tmp_path: Path, content, seed) -> None:
    random = np.random.default_rng(seed)
    damaged = bytearray(content)
    reach = len(damaged) if seed % 2 else 4000
    for place in random.integers(8, reach, size=1 + seed % 7):
        damaged[place] = random.integers(256)
    outcome(tmp_path, bytes(damaged))


def outcome(folder: Path, content: bytes) -> None:
    try:
        recording = read(folder / "bag.mcap", content)
    except IdimError as error:
        assert "bag.mcap" in str(error)
        assert "\n" not in str(error)
    else:
        assert np.isfinite(recording.position.values).all()
