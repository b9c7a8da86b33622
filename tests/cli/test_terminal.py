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


@pytest.mark.parametrize(
    "urdf",
    [
        "<robot",
        '<robot name="a"><link name="b"/><link name="c"/></robot>',
    ],
)
def test_a_urdf_that_is_none_is_one_line_on_the_terminal(run, config, tmp_path: Path, urdf) -> None:
    (tmp_path / "bad.urdf").write_text(urdf)
    bad = config((str(CONFIG / "arm2.urdf"), str(tmp_path / "bad.urdf")))
    done = run(f"excite --config {bad} --out {tmp_path / 'out'}", status=2)
    refused(done, 2, f"{tmp_path / 'bad.urdf'}: ")
    assert done.out == ""
