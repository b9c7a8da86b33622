"""A ROS domain that no other process of tests is in."""

import fcntl
import os
import tempfile
from pathlib import Path

DOMAINS = range(20, 100)


def free_domain() -> int:
    """Number of a domain that is this process's until it ends.

    Two workers, or two suites on one machine, that shared a domain would hear each other's nodes.
    The domain is a lock on a file beside temporary files, which the system releases however the
    process ends.

    Raises
    ------
    RuntimeError
        All are taken.
    """
    for domain in DOMAINS:
        path = Path(tempfile.gettempdir()) / f"idim_iv_ros_domain_{domain}.lock"
        lock = os.open(path, os.O_CREAT | os.O_RDWR, 0o666)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(lock)
            continue
        return domain
    raise RuntimeError(f"{len(DOMAINS)} suites run on this machine: no ROS domain is free")
