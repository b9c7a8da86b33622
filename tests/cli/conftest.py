"""Recordings and configurations for the command line."""

import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from bags import simulated_arms
from idim_iv_ros.cli.diagnose import diagnose_command
from idim_iv_ros.cli.main import main
from idim_iv_ros.recording.writing.write import JointTopic, write_bag

REPOSITORY = Path(__file__).resolve().parents[2]
CONFIG = REPOSITORY / "config"
START = "from idim_iv_ros.cli.main import main; main()"
JOINTS = ["joint_1", "joint_2"]


class Outcome(NamedTuple):
    """What a user sees."""

    status: int
    out: str
    error: str


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capfd) -> Callable[..., Outcome]:
    """Run the command line in this process, which ends with `status` if one is given.

    The first argument may be a whole command with its words separated by blanks.
    """

    def call(
        command: str, *arguments: object, status: int | None = None, columns: int = 200
    ) -> Outcome:
        words = [*command.split(), *map(str, arguments)]
        monkeypatch.setattr(sys, "argv", ["idim-iv", *words])
        monkeypatch.setenv("COLUMNS", str(columns))
        with pytest.raises(SystemExit) as stopped:
            main()
            raise SystemExit(0)
        captured = capfd.readouterr()
        outcome = Outcome(int(stopped.value.code or 0), captured.out, captured.err)
        assert status in (None, outcome.status), outcome
        return outcome

    return call


def refused(outcome: Outcome, status: int, *words: str) -> None:
    """One line on stderr that starts with the program's name and holds all words."""
    assert outcome.status == status, outcome
    (line,) = said(outcome.error)
    assert line.startswith("idim-iv: ")
    for word in words:
        assert word in line, (word, line)


def said(error: str) -> list[str]:
    """What was said on stderr, without progress."""
    return [line for line in error.splitlines() if line.strip() and not re.match(r"\d+ s: ", line)]


def in_process(*arguments: object, code: str = START, **environment: str) -> Outcome:
    """Run the command as a process of its own, as a user's shell does, with buffered streams."""
    variables = {name: value for name, value in os.environ.items() if name not in NOT_OF_USERS}
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        capture_output=True,
        env={**variables, "PYTHONPATH": str(REPOSITORY), "COLUMNS": "80", **environment},
        check=False,
        timeout=120,
        preexec_fn=as_in_a_terminal,
    )
    return Outcome(done.returncode, done.stdout.decode(), done.stderr.decode())


NOT_OF_USERS = ("PYTHONUNBUFFERED", "PYTHONWARNINGS")


def as_in_a_terminal() -> None:
    """Heed the signals that a shell in the background, or nohup, lets its children ignore."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.fixture
def diagnose(config, tmp_path: Path, monkeypatch) -> Callable[..., None]:
    """Run the command with something else in the place of what computes a diagnosis."""

    def call(stand_in: Callable, bags: Sequence[Path] = (), **options: object) -> None:
        monkeypatch.setenv("COLUMNS", "140")
        monkeypatch.setattr("idim_iv_ros.diagnosis.diagnose.diagnose", stand_in)
        given = {"out": tmp_path / "why", "without": None, "against": None, **options}
        diagnose_command(list(bags), config(), **given)

    return call


@pytest.fixture(scope="session")
def record():
    """Six seconds of the two-joint arm."""
    return simulated_arms.record(simulated_arms.arm2(seconds=6.0), 1)


@pytest.fixture
def columns(record, tmp_path: Path) -> Path:
    """A table of the record and its map."""
    arrays = {"q": record.position, "tau": record.effort, "ref": record.position_reference}
    np.savez(tmp_path / "run.npz", **arrays)
    path = tmp_path / "map.yaml"
    path.write_text(
        "file: run.npz\nrate: 1000.0\njoints:\n"
        "  joint_1: {position: 'q[0]', effort: 'tau[0]', reference: 'ref[0]'}\n"
        "  joint_2: {position: 'q[1]', effort: 'tau[1]', reference: 'ref[1]'}\n"
    )
    return path


@pytest.fixture(scope="session")
def bag(record, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same as a bag."""
    return write_arm(tmp_path_factory.mktemp("bags") / "arm2.mcap", record)


def write_arm(path: Path, record, rows=slice(None), **changed: np.ndarray) -> Path:
    """Write some rows of a record as joint states and references, with other signals in places."""
    names = ("time", "position", "effort", "position_reference")
    signals = {name: getattr(record, name) for name in names} | changed
    time, position, effort, reference = (signals[name][rows] for name in names)
    topics = [
        JointTopic("/joint_states", JOINTS, time, position, None, effort),
        JointTopic("/joint_reference", JOINTS, time, reference),
    ]
    write_bag(path, topics)
    return path


@pytest.fixture
def config(tmp_path: Path) -> Callable[..., Path]:
    """Write arm2's configuration with replacements."""

    def write(*replacements: tuple[str, str], extra: str = "") -> Path:
        text = (CONFIG / "arm2.yaml").read_text()
        text = text.replace("urdf: arm2.urdf", f"urdf: {CONFIG / 'arm2.urdf'}")
        for old, new in replacements:
            assert old in text, old
            text = text.replace(old, new)
        path = tmp_path / "arm2.yaml"
        path.write_text(text + extra)
        return path

    return write
