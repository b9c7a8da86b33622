"""Real recordings live beside the project, not in it; without them these tests are skipped."""

from pathlib import Path

import pytest

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
