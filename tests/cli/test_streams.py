"""Where a command's words go may have no UTF-8, no room, no width, or nobody who reads."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.conftest import REPOSITORY, START, Outcome, in_process, refused, said

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


def test_a_result_of_a_bag_whose_name_is_no_text_is_written_and_read(run, config, bag, tmp_path):
    named = tmp_path / os.fsdecode(b"b\xe9.mcap")
    shutil.copy(bag, named)
    run("identify", named, "--config", config(), "--out", tmp_path / "out", status=0)
    document = json.loads((tmp_path / "out" / "result.json").read_text())
    assert [Path(used["path"]).name for used in document["bags"]] == [r"b\xe9.mcap"]
    assert r"b\xe9.mcap" in (tmp_path / "out" / "report.html").read_text()
    first = run("init", named, "--urdf", document["configuration"]["robot"]["urdf"],
                "--out", tmp_path / "first.yaml")  # fmt: skip
    assert first.status == 0, first.error


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


def test_an_option_is_refused_in_our_words(run, config) -> None:
    done = run("simulate", "--config", config(), "--out", "a.mcap", "--duration", 0, status=2)
    assert "--duration" in done.error and "Input should" not in done.error
