"""A reader that finds nothing any more ends soon, whatever the size of the file says."""

import os
import resource
import struct
from pathlib import Path

import numpy as np
import pytest

from idim_iv_ros.errors import DataError
from idim_iv_ros.recording import JointTopic, read_recordings, write_bag

GIGABYTE = 1 << 30
FEW = 20_000  # pages
MAGIC = b"\x89MCAP0\r\n"
CHUNK, MESSAGE = 6, 5


@pytest.fixture(scope="module")
def content(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("bag") / "bag.mcap"
    values = np.random.default_rng(0).normal(size=(4000, 2))
    stamps = np.arange(4000) / 1000.0
    write_bag(path, [JointTopic("/joint_states", ["a", "b"], stamps, values, None, values)])
    return path.read_bytes()


def faults() -> int:
    """Pages that this process has touched first; three gigabytes have at least 49 thousand."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_minflt + usage.ru_majflt


def read(path: Path):
    """The recording, and how many pages were touched for it."""
    before = faults()
    (recording,) = read_recordings([path], joints=["a", "b"])
    return recording, faults() - before


def test_three_gigabytes_of_nothing_behind_half_a_bag_are_not_read(tmp_path: Path, content) -> None:
    path = tmp_path / "bag.mcap"
    path.write_bytes(content[: len(content) // 2])
    os.truncate(path, 3 * GIGABYTE)
    recording, pages = read(path)
    assert 500 < recording.samples < 3500
    assert any("ends in the middle" in note.what for note in recording.notes)
    assert pages < FEW


def test_what_lies_behind_a_hole_is_read(tmp_path: Path, content) -> None:
    path = tmp_path / "bag.mcap"
    with path.open("wb") as file:
        file.write(content[: len(content) // 2])
        file.seek(3 * GIGABYTE, os.SEEK_SET)
        file.write(content[len(content) // 2 :])
    recording, pages = read(path)
    assert recording.samples > 3500
    assert pages < FEW


@pytest.mark.parametrize(("opcode", "head"), [(MESSAGE, b""), (CHUNK, b"chunk")])
def test_a_record_that_claims_gigabytes_is_not_loaded(tmp_path: Path, opcode, head) -> None:
    size = 3 * GIGABYTE
    if head:  # its parts agree: no compression, as many bytes as it claims
        head = struct.pack("<QQQIIQ", 0, 0, size, 0, 0, size)
        size += len(head)
    path = tmp_path / "bag.mcap"
    path.write_bytes(MAGIC + struct.pack("<BQ", opcode, size) + head)
    os.truncate(path, len(MAGIC) + 9 + size)
    before = faults()
    with pytest.raises(DataError, match="nothing can be read"):
        read_recordings([path], joints=["a", "b"])
    assert faults() - before < FEW


def test_garbage_is_searched_for_so_long_and_then_given_up(tmp_path: Path, content) -> None:
    noise = np.random.default_rng(1).bytes(1 << 20)
    path = tmp_path / "bag.mcap"
    with path.open("wb") as file:
        file.write(content[: len(content) // 2])
        for _ in range(130):  # 2 MiB more than are searched
            file.write(noise)
        file.write(content[len(content) // 2 :])
    recording, _ = read(path)
    assert 500 < recording.samples < 3500
