"""No two processes of tests share a ROS domain."""

import subprocess
import sys
from pathlib import Path

from tests.ros.domain import free_domain

CLAIM = (
    "from pathlib import Path; from tests.ros.domain import free_domain; "
    "print(free_domain(Path({folder!r})), flush=True); input()"
)


def test_processes_that_run_at_once_have_domains_of_their_own(tmp_path: Path) -> None:
    code = CLAIM.format(folder=str(tmp_path))
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    processes = [subprocess.Popen([sys.executable, "-c", code], **pipes) for _ in range(3)]
    try:
        claimed = [int(process.stdout.readline()) for process in processes]
    finally:
        for process in processes:
            process.communicate("\n")
    assert len(set(claimed)) == 3
    # All have ended: their domains are free again.
    assert free_domain(tmp_path) == min(claimed)
