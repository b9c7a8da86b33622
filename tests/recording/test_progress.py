"""A reader that finds nothing any more ends soon, whatever the size of the file says."""

import mmap
import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from idim_iv_ros.recording import JointTopic, read_recordings, write_bag
from idim_iv_ros.recording.bags import mcap

GIGABYTE = 1 << 30
FEW = 10 << 20  # bytes


@pytest.fixture(scope="module")
def content(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("bag") / "bag.mcap"
    values = np.random.default_rng(0).normal(size=(4000, 2))
    stamps = np.arange(4000) / 1000.0
    write_bag(path, [JointTopic("/joint_states", ["a", "b"], stamps, values, None, values)])
    return path.read_bytes()


class Counted(mmap.mmap):
    """A file in memory that counts the bytes that are copied from it."""

    taken = 0

    def __getitem__(self, key):
        part = super().__getitem__(key)
        Counted.taken += len(part) if isinstance(part, bytes) else 1
        return part


@pytest.fixture(autouse=True)
def counted(monkeypatch: pytest.MonkeyPatch) -> None:
    Counted.taken = 0
    monkeypatch.setattr(mcap, "mmap", SimpleNamespace(**{**vars(mmap), "mmap": Counted}))


def read(path: Path):
    (recording,) = read_recordings([path], joints=["a", "b"])
    return recording


def test_three_gigabytes_of_nothing_behind_half_a_bag_are_not_read(tmp_path: Path, content) -> None:
    path = tmp_path / "bag.mcap"
    path.write_bytes(content[: len(content) // 2])
    os.truncate(path, 3 * GIGABYTE)
    recording = read(path)
    assert 500 < recording.samples < 3500
    assert any("ends in the middle" in note.what for note in recording.notes)
    assert 0 < Counted.taken < FEW
