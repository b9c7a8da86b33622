"""How the command starts, and how Ctrl-C ends it at any moment."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import idim_iv_ros

REPOSITORY = Path(__file__).resolve().parents[2]
START = "from idim_iv_ros.cli.main import main; main()"
HEAVY = ("numpy", "scipy", "numba", "pinocchio", "plotly", "ruamel", "rosbags")
COMMANDS = (
    *("check", "diagnose", "excite", "export", "fleet", "identify", "import", "init", "predict"),
    *("record", "replay", "serve", "simulate", "watch"),
)


def started(*arguments: str, code: str = START, **environment: str) -> subprocess.Popen[str]:
    """The command in a process of its own."""
    variables = {**os.environ, "PYTHONPATH": str(REPOSITORY), "COLUMNS": "80", **environment}
    return subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=variables,
        preexec_fn=_as_in_a_terminal,
    )


def _as_in_a_terminal() -> None:
    """Heed the signals that a shell in the background, or nohup, lets its children ignore."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


def finished(*arguments: str, code: str = START, **environment: str) -> tuple[str, str]:
    process = started(*arguments, code=code, **environment)
    out, error = process.communicate(timeout=60)
    assert process.returncode == 0, error
    return out, error


@pytest.mark.parametrize("arguments", [(), *((command,) for command in COMMANDS)])
def test_help_loads_nothing_that_computes_or_draws(arguments: tuple[str, ...]) -> None:
    # Recent versions of typer read the options of a command with pydantic themselves.
    heavy = HEAVY if arguments else (*HEAVY, "pydantic")
    code = (
        f"import sys\ntry:\n    {START}\nexcept SystemExit:\n    pass\n"
        f"print([name for name in {heavy} if name in sys.modules], file=sys.stderr)"
    )
    out, error = finished(*arguments, "--help", code=code)
    assert "Usage" in out
    assert error.strip() == "[]"


def test_help_needs_less_than_a_second_of_the_processor() -> None:
    code = (
        f"import atexit, os, sys\n"
        f"atexit.register(lambda: print(sum(os.times()[:2]), file=sys.stderr))\n{START}"
    )
    spent = min(float(finished("--help", code=code)[1]) for _ in range(3))
    assert spent < 1.0


def test_version_is_that_of_the_package() -> None:
    out, _ = finished("--version")
    assert out.strip() == f"idim-iv {idim_iv_ros.__version__}"
    assert idim_iv_ros.__version__[0].isdigit()


def test_shell_completes_commands_and_options() -> None:
    def completed(words: str) -> str:
        environment = {"COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
        return finished(_IDIM_IV_COMPLETE="complete_bash", **environment, code=code)[0]

    code = f"import sys; sys.argv[0] = 'idim-iv'; {START}"
    assert completed("idim-iv ide").split() == ["identify"]
    assert completed("idim-iv identify --es").split() == ["--estimator"]


# From the first imports over loading and estimation to the drawing of the report.
MOMENTS = ("typer", "numpy", "rosbags", "idim_iv_ros.estimation.idim_iv", "scipy.stats", "plotly")


@pytest.mark.parametrize("module", MOMENTS)
def test_ctrl_c_is_one_line_and_leaves_nothing(
    module: str, bag: Path, config, tmp_path: Path
) -> None:
    """The signal comes when a module is imported."""
    code = (
        "import os, signal, sys\nsent = []\n"
        "def interrupt(event, arguments):\n"
        f"    if event == 'import' and arguments[0] == {module!r} and not sent:\n"
        "        sent.append(os.kill(os.getpid(), signal.SIGINT))\n"
        f"sys.addaudithook(interrupt)\n{START}"
    )
    out = tmp_path / "results"
    arguments = ("identify", str(bag), "--config", str(config()), "--out", str(out))
    process = started(*arguments, code=code)
    _, error = process.communicate(timeout=120)
    lines = [line for line in error.splitlines() if " s: " not in line]  # progress
    assert (process.returncode, lines) == (130, ["idim-iv: interrupted"]), error
    if out.exists():  # the page was being drawn: the numbers are there, and whole
        assert [path.name for path in out.iterdir()] == ["result.json"]
        assert json.loads((out / "result.json").read_text())["parameters"]
    left = {path.name for path in tmp_path.iterdir()} - {"results"}
    assert left == {"arm2.yaml"}


@pytest.mark.parametrize(
    ("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)]
)
def test_a_signal_is_not_lost_in_code_that_swallows_every_exception(
    number: signal.Signals, status: int, tmp_path: Path
) -> None:
    code = (
        "import os, sys\n"
        "from pathlib import Path\n"
        "from idim_iv_ros.files import complete_files, made_folder\n"
        "from idim_iv_ros.interruption import interruption_ends_process\n"
        "out = Path(sys.argv[1], 'deep', 'out')\n"
        "file = out / 'a.gif'\n"
        "with interruption_ends_process(), made_folder(out), complete_files([file]) as new:\n"
        "    new[file].write_text('half')\n"
        "    try:\n        os.kill(os.getpid(), int(sys.argv[2]))\n        [0] * 10\n"
        "    except BaseException:\n        pass\n"
        "print('went on')"
    )
    process = started(str(tmp_path), str(int(number)), code=code)
    out, error = process.communicate(timeout=60)
    assert (process.returncode, out) == (status, "")
    assert error.startswith("idim-iv: ") and error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_files_that_belong_together_are_not_parted_by_ctrl_c(tmp_path: Path) -> None:
    """The signal comes between the two renames."""
    code = (
        "import os, signal, sys\nfrom pathlib import Path\n"
        "from idim_iv_ros.files import write_together\n"
        "from idim_iv_ros.interruption import interruption_ends_process\n"
        "folder, replace = Path(sys.argv[1]), Path.replace\n"
        "def interrupted(path, other):\n"
        "    os.kill(os.getpid(), signal.SIGINT)\n    return replace(path, other)\n"
        "Path.replace = interrupted\n"
        "with interruption_ends_process():\n"
        "    write_together({folder / 'a': '1', folder / 'b': '2'})\n"
        "print('went on')"
    )
    process = started(str(tmp_path), code=code)
    out, error = process.communicate(timeout=60)
    assert (process.returncode, out, error) == (130, "", "idim-iv: interrupted\n")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]
