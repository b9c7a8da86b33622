"""Where a command's words go may have no UTF-8, no room, no width, or nobody who reads."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.test_bad_input import refused
from tests.cli.test_start import REPOSITORY, START

PLAIN = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
ASCII = {"PYTHONIOENCODING": "ascii"}


def ended(
    *arguments: object, out: object = subprocess.PIPE, **environment: str
) -> subprocess.CompletedProcess[bytes]:
    """Run the command in a process of its own, whose streams are bytes and buffered."""
    return subprocess.run(
        [sys.executable, "-c", START, *map(str, arguments)],
        stdout=out,  # type: ignore[call-overload]
        stderr=subprocess.PIPE,
        env={**buffered(), "PYTHONPATH": str(REPOSITORY), "COLUMNS": "80", **environment},
        check=False,
    )


def buffered() -> dict[str, str]:
    """The environment of the tests, but for what would write every line at once."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}


def lines(error: bytes) -> list[str]:
    """What was said, without progress."""
    return [line for line in error.decode().splitlines() if " s: " not in line]


@pytest.mark.parametrize("locale", [PLAIN, ASCII])
def test_a_name_and_a_terminal_of_other_encodings(
    config, bag: Path, tmp_path: Path, locale: dict[str, str]
) -> None:
    named = tmp_path / os.fsdecode(b"b\xe9.mcap")
    shutil.copy(bag, named)
    done = ended("check", named, "--config", config(), **locale)
    assert (done.returncode, lines(done.stderr)) == (0, [])
    assert rb"b\xe9.mcap" in done.stdout and b"sigma <= 10" in done.stdout


def test_a_document_is_the_same_in_any_encoding(run, config, bag: Path, tmp_path: Path) -> None:
    named = tmp_path / os.fsdecode(b"b\xe9.mcap")
    shutil.copy(bag, named)
    document = ended("check", named, "--config", config(), "--json", **PLAIN, **ASCII)
    assert json.loads(document.stdout) == json.loads(
        run("check", named, "--config", config(), "--json").out
    )
    assert rb'"b\\xe9.mcap"' in document.stdout


def test_a_result_of_a_bag_whose_name_is_no_text_is_written_and_read(
    run, config, bag: Path, tmp_path: Path
) -> None:
    named = tmp_path / os.fsdecode(b"b\xe9.mcap")
    shutil.copy(bag, named)
    run("identify", named, "--config", config(), "--out", tmp_path / "out", status=0)
    document = json.loads((tmp_path / "out" / "result.json").read_text())
    assert [Path(used["path"]).name for used in document["bags"]] == [r"b\xe9.mcap"]
    assert r"b\xe9.mcap" in (tmp_path / "out" / "report.html").read_text()
    first = run("init", named, "--urdf", document["configuration"]["robot"]["urdf"],
                "--out", tmp_path / "first.yaml")  # fmt: skip
    assert first.status == 0, first.error


@pytest.mark.parametrize("arguments", [("--version",), ("--help",)])
def test_a_full_disk_is_a_line_and_no_defect(arguments: tuple[str, ...]) -> None:
    with Path("/dev/full").open("wb") as full:
        done = ended(*arguments, out=full)
    assert done.returncode == 1
    assert lines(done.stderr) == ["idim-iv: stdout: No space left on device"]


def test_a_stdout_that_is_closed_is_refused_before_a_file_takes_its_place() -> None:
    done = subprocess.run(
        ["sh", "-c", '"$0" -c "$1" --version >&-', sys.executable, START],
        capture_output=True,
        text=True,
        env={**buffered(), "PYTHONPATH": str(REPOSITORY)},
        check=False,
    )
    assert done.returncode == 2
    assert "stdout is closed" in done.stderr and done.stderr.count("\n") == 1


@pytest.mark.parametrize("columns", ["0", "x"])
def test_a_width_that_is_none_is_that_of_no_terminal(columns: str) -> None:
    done = ended("check", "--help", COLUMNS=columns)
    assert done.returncode == 0
    assert b"--config" in done.stdout


@pytest.mark.parametrize(
    "arguments", [("--out", "-"), ("--out=-",), ("--out", ""), ("--trajectory", "")]
)
def test_no_file_is_named_by_a_dash_or_by_nothing(
    run, config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    path = config()
    refused(run("simulate", "--config", path, "--duration", 1, *arguments), 2)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_an_option_is_refused_in_our_words(run, config) -> None:
    done = run("simulate", "--config", config(), "--out", "a.mcap", "--duration", 0, status=2)
    assert "--duration" in done.error and "Input should" not in done.error
