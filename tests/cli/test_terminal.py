"""What a program prints that a user starts: nothing but its own lines."""

from pathlib import Path

import pytest

from tests.cli.conftest import CONFIG, START, in_process, refused, write_arm


@pytest.mark.parametrize("command", ["identify", "diagnose", "check"])
def test_efforts_that_no_drive_has_are_refused_in_one_line(run, config, record, tmp_path, command):
    bag = write_arm(tmp_path / "odd.mcap", record, effort=record.effort * [1.0, 1e-160])
    out = [] if command == "check" else ["--out", tmp_path / "out"]
    done = run(command, bag, "--config", config(), *out)
    refused(done, 1, "odd.mcap: the largest torque of joint_2", "N m")


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
    assert in_process(*arguments, code=broken + START).error == ""
    asked = in_process(*arguments, code=broken + START, IDIM_IV_TRACEBACK="1")
    assert "overflow encountered" in asked.error
