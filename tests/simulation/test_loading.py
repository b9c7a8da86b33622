"""What a simulation loads and compiles before its first step."""

import subprocess
import sys

MODULES = "idim_iv_ros.identification.identify, idim_iv_ros.simulators.recording"
HEAVY = {"scipy.signal", "scipy.stats", "scipy.optimize", "scipy.interpolate", "plotly"}


def test_filters_statistics_and_drawings_are_loaded_when_they_are_used() -> None:
    code = f"import sys, {MODULES}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert HEAVY & set(done.stdout.split()) == set()
