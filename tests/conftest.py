"""One thread of linear algebra for each worker: the workers share the cores.

Small matrices on several threads take several times the processor time of one. The variables count
when numpy is loaded, and go on to the commands and nodes that the tests start.
"""

import gc
import os
import sys
from collections.abc import Iterator

import pytest

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")
# Bytecode is kept: else every worker and every node that a test starts would compile the package.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False


@pytest.fixture(autouse=True, scope="session")
def one_line_errors() -> Iterator[None]:
    """Let every message for the user fail its test, whichever it is, if it is not one line."""
    from idim_iv_ros.errors import IdimError

    def checked(error: IdimError, *words: object) -> None:
        Exception.__init__(error, *words)
        assert "\n" not in str(error)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(IdimError, "__init__", checked)
        yield


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Spread the files with tests of nodes, which mostly wait, between those that compute."""
    files = list(dict.fromkeys(item.path for item in items))
    nodes = [path for path in files if path.parent.name == "ros"]
    others = [path for path in files if path.parent.name != "ros"]
    places = {
        path: (place / len(kind), str(path))
        for kind in (nodes, others)
        for place, path in enumerate(kind)
    }
    items.sort(key=lambda item: places[item.path])


def pytest_collection_finish() -> None:
    """Spare what all modules loaded from every later search for garbage: a tenth of the time."""
    gc.collect()
    gc.freeze()
