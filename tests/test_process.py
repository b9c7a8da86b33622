"""The process: memory that is freed, one thread for linear algebra, what is loaded."""

import platform
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from idim_iv_ros.compilation import return_freed_memory

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


AFTER = """
from idim_iv_ros.compilation import one_thread
with one_thread():
    import scipy.linalg, scipy.signal, scipy.stats
    from threadpoolctl import threadpool_info
    print(*[pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"])
"""


def test_what_is_imported_later_has_one_thread_too(monkeypatch) -> None:
    """numpy and scipy bring a library each; a limit holds only for what is loaded."""
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    said = subprocess.run(
        [sys.executable, "-c", AFTER], capture_output=True, text=True, check=True
    ).stdout.split()
    assert len(said) >= 2
    assert set(said) == {"1"}


MODULES = "idim_iv_ros.identification.identify, idim_iv_ros.simulators.recording"
HEAVY = {"scipy.signal", "scipy.stats", "scipy.optimize", "scipy.interpolate", "plotly"}


def test_filters_statistics_and_drawings_are_loaded_when_they_are_used() -> None:
    code = f"import sys, {MODULES}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert HEAVY & set(done.stdout.split()) == set()
