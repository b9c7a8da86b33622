"""Where a command's words go: no UTF-8, no room, no width, nobody who reads, a narrow terminal."""

import io
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from rich.console import Console

from idim_iv_ros.cli.diagnosis_tables import print_diagnosis
from idim_iv_ros.cli.output import print_table
from tests.cli.conftest import (
    CONFIG,
    REPOSITORY,
    START,
    Outcome,
    in_process,
    refused,
    said,
    write_arm,
)
from tests.report.sample_gap import sample_gap

PLAIN = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}


def test_a_name_and_a_terminal_of_other_encodings(run, config, bag, tmp_path) -> None:
    """A table is spelt with what there is, and a document is the same as elsewhere."""
    named = tmp_path / os.fsdecode(b"b\xe9.mcap")
    shutil.copy(bag, named)
    arguments = ("check", named, "--config", config())
    twice = (
        f"import sys\ntry:\n    {START}\nexcept SystemExit as end:\n    assert not end.code\n"
        f"print('\\f', end='')\nsys.argv.append('--json')\n{START}"
    )
    done = in_process(*arguments, code=twice, **PLAIN)
    assert (done.status, said(done.error)) == (0, [])
    table, document = done.out.split("\f")
    assert r"b\xe9.mcap" in table and "sigma <= 10" in table
    assert json.loads(document) == json.loads(run(*arguments, "--json").out)
    assert r'"b\\xe9.mcap"' in document


@pytest.mark.parametrize("option", ["--version", "--help"])
@pytest.mark.parametrize(
    ("stdout", "status", "words"),
    [(">/dev/full", 1, "stdout: No space left on device"), (">&-", 2, "stdout is closed")],
)
def test_a_stdout_that_takes_nothing_is_a_line_and_no_defect(option, stdout, status, words) -> None:
    """A closed one is refused before a file takes its place."""
    call = ["sh", "-c", f'"$0" -c "$1" {option} {stdout}', sys.executable, START]
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    environment = {**buffered, "PYTHONPATH": str(REPOSITORY)}
    done = subprocess.run(call, capture_output=True, text=True, env=environment, check=False)
    refused(Outcome(done.returncode, done.stdout, done.stderr), status, words)


@pytest.mark.parametrize("columns", ["0", "x"])
def test_a_width_that_is_none_is_that_of_no_terminal(columns: str) -> None:
    done = in_process("check", "--help", COLUMNS=columns)
    assert done.status == 0 and "--config" in done.out


@pytest.mark.parametrize(
    "arguments", [("--out", "-"), ("--out=-",), ("--out", ""), ("--trajectory", "")]
)
def test_no_file_is_named_by_a_dash_or_by_nothing(run, config, tmp_path, monkeypatch, arguments):
    monkeypatch.chdir(tmp_path)
    path = config()
    refused(run("simulate", "--config", path, "--duration", 1, *arguments), 2)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


LONG = "shoulder_pan_joint_very_long"
COLUMNS = ["joint", ">torque", "what was found"]
ROWS = [
    (LONG, "12.5 N m", "ZZ1 + Ia1 + YY2 + 0.0484·M3 grows with the speed"),
    ("elbow", "0.3 N m", "nothing"),
]


def printed(width: int, rows=ROWS, **options) -> str:
    console = Console(file=io.StringIO(), width=width)
    print_table(console, "Joints", COLUMNS, rows, **options)
    return console.file.getvalue()


@pytest.mark.parametrize("width", [12, 40, 60, 120])
def test_no_name_and_no_number_with_its_unit_is_cut(width: int) -> None:
    text = printed(width)
    assert all(whole in text for whole in (LONG, "12.5 N m", "0.3 N m", "elbow"))


@pytest.mark.parametrize("width", [80, 110])
def test_a_diagnosis_fits_and_keeps_the_names_of_its_joints(width: int) -> None:
    console = Console(file=io.StringIO(), width=width)
    print_diagnosis(console, sample_gap(6, "both", first=LONG))
    text = console.file.getvalue()
    assert max(len(line.rstrip()) for line in text.splitlines()) <= width
    assert len(text.splitlines()) <= 50
    assert LONG in text


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
