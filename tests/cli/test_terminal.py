"""What a program prints that a user starts: nothing but its own lines."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import CONFIG, write_arm

PROGRAM = "from idim_iv_ros.cli.main import main; main()"


def started(*arguments: object, before: str = "") -> subprocess.CompletedProcess[str]:
    """Run the command as a process of its own, as a user's shell does."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONWARNINGS"}
    return subprocess.run(
        [sys.executable, "-c", before + PROGRAM, *map(str, arguments)],
        capture_output=True,
        text=True,
        env=environment,
        check=False,
    )


def lines(text: str) -> list[str]:
    return [line for line in text.splitlines() if line.strip()]


@pytest.fixture
def odd(config, record, tmp_path: Path):
    """A recording with other efforts, and the configuration of its arm."""

    def write(effort: np.ndarray) -> tuple[Path, Path]:
        return write_arm(tmp_path / "odd.mcap", record, effort=effort), config()

    return write


@pytest.mark.parametrize("command", ["identify", "diagnose", "check"])
def test_efforts_that_no_drive_has_are_refused_in_one_line(
    run, odd, record, tmp_path: Path, command
) -> None:
    effort = record.effort.copy()
    effort[:, 1] *= 1e-160
    bag, config = odd(effort)
    out = [] if command == "check" else ["--out", tmp_path / "out"]
    done = run(command, bag, "--config", config, *out, status=1)
    (line,) = lines(done.error)
    assert line.startswith("idim-iv: odd.mcap: the largest torque of joint_2 is")
    assert "N m" in line


def test_a_poor_recording_prints_no_warning_of_a_library(odd, record, tmp_path: Path) -> None:
    effort = np.round(record.effort / 5.0) * 5.0
    effort[:, 1] = 1.0
    bag, config = odd(effort)
    done = started("identify", bag, "--config", config, "--out", tmp_path / "out")
    assert done.returncode in (0, 1)
    # On a busy machine progress is printed, too: "5 s: validation, 97 %".
    said = [line for line in lines(done.stderr) if " s: " not in line]
    assert all(line.startswith("idim-iv: ") for line in said), done.stderr


def test_warnings_of_libraries_are_not_shown_but_can_be_asked_for(tmp_path: Path) -> None:
    broken = (
        "import warnings, idim_iv_ros.configuration as read, idim_iv_ros.cli.main as main_module\n"
        "def load(path):\n"
        "    warnings.warn('overflow encountered', RuntimeWarning)\n"
        "    warnings.warn('pkg_resources is deprecated', UserWarning)\n"
        "    raise SystemExit(0)\n"
        "read.load_configuration = load\n"
    )
    arguments = ("check", tmp_path / "a.mcap", "--config", CONFIG / "arm2.yaml")
    assert started(*arguments, before=broken).stderr == ""
    asked = "import os; os.environ['IDIM_IV_TRACEBACK'] = '1'\n" + broken
    assert "overflow encountered" in started(*arguments, before=asked).stderr


@pytest.mark.parametrize(
    "urdf",
    [
        "",
        "<robot",
        "<sdf/>",
        '<robot name="a"><link name="b"/><link name="c"/></robot>',
        '<robot name="a"><link name="b"/><joint name="j" type="revolute"/></robot>',
        '<robot name="a"><link name="b"><inertial><mass value="1"/></inertial></link></robot>',
    ],
)
def test_a_urdf_that_is_none_is_one_line_on_the_terminal(run, config, tmp_path: Path, urdf) -> None:
    (tmp_path / "bad.urdf").write_text(urdf)
    bad = config((str(CONFIG / "arm2.urdf"), str(tmp_path / "bad.urdf")))
    done = run(f"excite --config {bad} --out {tmp_path / 'out'}", status=2)
    (line,) = lines(done.error)
    assert line.startswith(f"idim-iv: {tmp_path / 'bad.urdf'}: ")
    assert done.out == ""
