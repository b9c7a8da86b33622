"""How the command starts, and how Ctrl-C ends it at any moment."""

import json
import signal
from pathlib import Path

import pytest

import idim_iv_ros
from tests.cli.conftest import START, in_process, said

HEAVY = ("numpy", "scipy", "numba", "pinocchio", "plotly", "ruamel", "rosbags")
COMMANDS = (
    *("check", "diagnose", "excite", "export", "fleet", "identify", "import", "init", "predict"),
    *("record", "replay", "serve", "simulate", "watch"),
)


def test_help_loads_nothing_that_computes_or_draws() -> None:
    """All commands in one process, which ends at the first that loads something."""
    # Recent versions of typer read the options of a command with pydantic themselves.
    code = (
        "import sys\n"
        f"for command in {('', *COMMANDS)}:\n"
        "    sys.argv = ['idim-iv', *command.split(), '--help']\n"
        f"    try:\n        {START}\n    except SystemExit as end:\n        status = end.code\n"
        f"    heavy = {HEAVY} if command else {(*HEAVY, 'pydantic')}\n"
        "    loaded = [name for name in heavy if name in sys.modules]\n"
        "    print('\\f', end='')\n"
        "    if status or loaded:\n        sys.exit(f'{command}: {status}, {loaded}')"
    )
    done = in_process(code=code)
    assert (done.status, done.error) == (0, "")
    for command, page in zip(("", *COMMANDS), done.out.split("\f")[:-1], strict=True):
        assert ("Usage" if command in ("", "fleet") else "Example: idim-iv ") in page, page


def test_version_is_that_of_the_package() -> None:
    assert in_process("--version").out.strip() == f"idim-iv {idim_iv_ros.__version__}"
    assert idim_iv_ros.__version__[0].isdigit()


def test_shell_completes_commands_and_options() -> None:
    def completed(words: str) -> str:
        environment = {"COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
        return in_process(_IDIM_IV_COMPLETE="complete_bash", **environment, code=code).out

    code = f"import sys; sys.argv[0] = 'idim-iv'; {START}"
    assert completed("idim-iv ide").split() == ["identify"]
    assert completed("idim-iv identify --es").split() == ["--estimator"]


# From the first imports over loading and estimation to the drawing of the report.
MOMENTS = ("typer", "rosbags", "idim_iv_ros.estimation.idim_iv", "plotly")


@pytest.mark.parametrize("module", MOMENTS)
def test_ctrl_c_is_one_line_and_leaves_nothing(module, bag, config, tmp_path) -> None:
    """The signal comes when a module is imported."""
    code = (
        "import os, signal, sys\nsent = []\n"
        "def interrupt(event, arguments):\n"
        f"    if event == 'import' and arguments[0] == {module!r} and not sent:\n"
        "        sent.append(os.kill(os.getpid(), signal.SIGINT))\n"
        f"sys.addaudithook(interrupt)\n{START}"
    )
    out = tmp_path / "results"
    arguments = ("identify", bag, "--config", config(), "--out", out)
    done = in_process(*arguments, code=code)
    assert (done.status, said(done.error)) == (130, ["idim-iv: interrupted"]), done.error
    if out.exists():  # the page was being drawn: the numbers are there, and whole
        assert [path.name for path in out.iterdir()] == ["result.json"]
        assert json.loads((out / "result.json").read_text())["parameters"]
    assert {path.name for path in tmp_path.iterdir()} - {"results"} == {"arm2.yaml"}


@pytest.mark.parametrize(
    ("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)]
)
def test_a_signal_is_not_lost_in_code_that_swallows_every_exception(number, status, tmp_path):
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
    done = in_process(tmp_path, int(number), code=code)
    assert (done.status, done.out) == (status, "")
    assert done.error.startswith("idim-iv: ") and done.error.count("\n") == 1
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
    assert in_process(tmp_path, code=code) == (130, "", "idim-iv: interrupted\n")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]
