"""The command `idim-iv`: arguments in, one public function, a short table out."""

import atexit
import os
import signal
import sys
from collections.abc import Sequence
from itertools import pairwise

from idim_iv_ros.interruption import SIGNALS, STATUS, interruption_ends_process

WRONG_USE = 2  # exit status
CONFIGURED = {
    *("check", "diagnose", "excite", "fleet", "identify", "predict", "record", "replay", "serve"),
    "simulate",
}


def main() -> None:
    """Run the command line; every failure is one line on stderr and an exit status.

    With ``IDIM_IV_TRACEBACK`` set in the environment, unexpected errors keep their traceback.
    """
    # While the interpreter ends, there is nothing left to interrupt.
    for number in SIGNALS:
        atexit.register(signal.signal, number, signal.SIG_IGN)
    with interruption_ends_process():
        # Here, so that Ctrl-C has its answer while they are imported.
        from idim_iv_ros.cli.application import application
        from idim_iv_ros.cli.streams import STDOUT, drop_stdout, prepare_streams
        from idim_iv_ros.errors import IdimError, silence_foreign_warnings

        silence_foreign_warnings()
        try:
            prepare_streams()
            _require_names(sys.argv[1:])
            try:
                application()
            finally:
                sys.stdout.flush()
        except SystemExit as stopped:
            if stopped.code == WRONG_USE and _lacks_configuration(sys.argv[1:]):
                _complain("`idim-iv init BAG… --urdf FILE` writes a first file for --config")
            raise
        except IdimError as error:
            _complain(_one_line(error))
            sys.exit(error.exit_status)
        except KeyboardInterrupt:
            print("idim-iv: interrupted", file=sys.stderr)
            sys.exit(STATUS)
        except BrokenPipeError:
            drop_stdout()
            sys.exit(1)
        except MemoryError:
            _complain("not enough memory; use fewer or shorter bags")
            sys.exit(1)
        except Exception as error:
            if os.environ.get("IDIM_IV_TRACEBACK"):
                raise
            _complain(_of_system(error))
            if isinstance(error, OSError) and error.filename == STDOUT:
                drop_stdout()
            sys.exit(1)


def _of_system(error: Exception) -> str:
    """What the machine refuses is no defect, wherever it comes up."""
    if isinstance(error, OSError):
        where = "" if error.filename is None else f"{error.filename}: "
        return f"{where}{error.strerror or _one_line(error)}"
    if isinstance(error, UnicodeEncodeError):
        part = error.object[error.start : error.end]
        word = next((each for each in error.object.split() if part in each), part)
        advice = "rename it" if error.encoding.startswith("utf") else "set PYTHONUTF8=1"
        return f"{word}: no name that can be written in {error.encoding}; {advice}"
    return (
        f"defect in idim_iv_ros ({type(error).__name__}: {_one_line(error)}); set "
        "IDIM_IV_TRACEBACK=1 and report what it prints"
    )


def _require_names(arguments: Sequence[str]) -> None:
    from idim_iv_ros.errors import UsageError

    for option, each in pairwise(["", *arguments]):
        if not each and option != "--namespace":
            raise UsageError("an argument is empty; is a variable of the shell not set?")
    if any(each == "-" or each.endswith("=-") for each in arguments):
        raise UsageError("-: name a file (./- if it has that name); --json prints results")


def _lacks_configuration(arguments: Sequence[str]) -> bool:
    """Whether a command that needs the robot's file was called without."""
    given = any(each.startswith("--config") for each in arguments)
    return bool(CONFIGURED.intersection(arguments[:1])) and not given


def _complain(text: str) -> None:
    from rich.console import Console
    from rich.text import Text

    line = Text.assemble(("idim-iv:", "bold red"), " ", text)
    Console(stderr=True, soft_wrap=True).print(line)


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())
