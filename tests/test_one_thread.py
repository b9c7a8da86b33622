"""One thread for linear algebra, whichever library does it."""

import subprocess
import sys

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
