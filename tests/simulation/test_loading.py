"""What a simulation loads and compiles before its first step."""

import subprocess
import sys

import pytest

HEAVY = ("scipy.signal", "scipy.stats", "scipy.optimize", "scipy.interpolate", "plotly")


def loaded_by(module: str) -> set[str]:
    code = f"import sys, {module}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


@pytest.mark.parametrize(
    "module",
    [
        "idim_iv_ros.simulation",
        "idim_iv_ros.identification.identify",
        "idim_iv_ros.simulators.recording",
    ],
)
def test_filters_statistics_and_drawings_are_loaded_when_they_are_used(module: str) -> None:
    assert loaded_by(module) & set(HEAVY) == set()
