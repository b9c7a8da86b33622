"""The node `identifier` whose worker's jobs wait for the test's go-ahead.

While the folder in which it is started holds the file `closed`, a job waits after the stage that is
written in it (empty: before it begins), with its process id in the file `job`.
"""

import os
import sys
import time
from collections.abc import Mapping
from pathlib import Path

from idim_iv_ros.nodes.identifier import identification_worker

_LOOK = 0.01  # s
ROOT = Path(__file__).resolve().parents[2]
FOLDER = Path.cwd()


def wait_at(stage: str) -> None:
    """Wait as long as the gate behind this stage is closed."""
    closed = FOLDER / "closed"
    if not closed.exists() or closed.read_text() != stage:
        return
    part = FOLDER / "job.part"
    part.write_text(str(os.getpid()))
    part.rename(FOLDER / "job")
    while closed.exists():
        time.sleep(_LOOK)


def gated(request: Mapping[str, object], send: identification_worker.Send) -> str:
    """Do the job, and wait where the test says so."""

    def send_and_wait(event: Mapping[str, object]) -> None:
        send(event)
        wait_at(str(event.get("stage", "")))

    wait_at("")
    return ungated(request, send_and_wait)


# The process of a job imports the file that was started, before it begins.
ungated = identification_worker._work
identification_worker._work = gated

if __name__ == "__main__":
    from idim_iv_ros.nodes.identifier.node import run

    os.environ["PYTHONPATH"] = f"{ROOT}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"
    sys.exit(run(sys.argv))
