"""Freed memory goes back to the system."""

import platform
from pathlib import Path

import numpy as np
import pytest

from idim_iv_ros.memory import return_freed_memory

SIZE = 50_000  # bytes: below what the C library asks the system for by itself


def resident() -> float:
    """MB of this process."""
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return int(next(line for line in lines if line.startswith("VmRSS")).split()[1]) / 1024.0


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="of the GNU C library")
def test_memory_that_was_freed_below_what_is_kept_is_returned() -> None:
    arrays = [np.ones(SIZE // 8) for _ in range(2000)]
    kept = arrays[-1]  # the heap does not shrink below it
    del arrays
    before = resident()
    return_freed_memory()
    assert resident() < before - 0.5 * 2000 * SIZE / 1e6
    assert kept.sum() == SIZE // 8
