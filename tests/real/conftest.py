"""Real recordings live beside the project, not in it; without them these tests are skipped."""

from pathlib import Path

import pytest

from idim_iv_ros.identification.result import IdentificationResult

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
CONFIG = Path(__file__).resolve().parents[2] / "config"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    if DATA.is_dir():
        return
    skip = pytest.mark.skip(reason=f"no real recordings at {DATA} (README: where they are)")
    for item in items:
        if "tests/real" in str(item.path):
            item.add_marker(skip)


@pytest.fixture(scope="session")
def data() -> Path:
    """Folder of the real recordings."""
    return DATA


@pytest.fixture(scope="session")
def config() -> Path:
    """Folder of the project's configurations."""
    return CONFIG


def require_bodies(result: IdentificationResult) -> None:
    """Every link is a body, no drive gives energy, and neither costs much where nothing was fit."""
    assert all(link.eigenvalues[0] > 0.0 for link in result.physical.links)
    for name, value in result.physical.values.items():
        assert value >= 0.0 or not name.startswith(("Ia", "Fv", "Fc"))
    error = result.physical.torque_error
    assert error.held_out_after <= 1.02 * error.held_out_before
