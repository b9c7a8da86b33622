"""Security that is switched on where Fast DDS lacks it, or has no keys."""

import os
import subprocess
import sys
from pathlib import Path

from tests.ros.conftest import ARM2
from tests.ros.processes import HANG, ROOT


def test_security_that_cannot_begin_is_one_line(tmp_path: Path) -> None:
    node = "recorder"
    (tmp_path / "enclaves").mkdir()
    environment = {
        **os.environ,
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        "ROS_SECURITY_ENABLE": "true",
        "ROS_SECURITY_STRATEGY": "Enforce",
        "ROS_SECURITY_KEYSTORE": str(tmp_path / "missing"),
    }
    ended = subprocess.run(
        [ROOT / "scripts" / node, "--ros-args", "-p", f"configuration:={ARM2}"],
        env=environment,
        capture_output=True,
        text=True,
        timeout=HANG,
        cwd=tmp_path,
    )
    assert ended.returncode == 2
    (line,) = [line for line in ended.stderr.splitlines() if not line.startswith("[INFO]")]
    assert line.startswith(f"{node}: DDS security is switched on (ROS_SECURITY_ENABLE)")
    assert "the wheels of PyPI have none" in line
