"""The command `idim-iv`: arguments in, one public function, a short table out."""

import atexit
import os
import signal
import sys
from collections.abc import Callable, Sequence
from io import TextIOWrapper
from itertools import pairwise

from idim_iv_ros.encoding import SPELT
from idim_iv_ros.errors import IdimError, UsageError, silence_foreign_warnings
from idim_iv_ros.interruption import SIGNALS, STATUS, interruption_ends_process


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

        silence_foreign_warnings()
        try:
            prepare_streams()
            _require_names(sys.argv[1:])
            try:
                application()
            finally:
                sys.stdout.flush()
        except IdimError as error:
            complain(str(error))
            sys.exit(error.exit_status)
        except KeyboardInterrupt:
            print("idim-iv: interrupted", file=sys.stderr)
            sys.exit(STATUS)
        except BrokenPipeError:
            _drop_stdout()
            sys.exit(1)
        except Exception as error:
            if os.environ.get("IDIM_IV_TRACEBACK") and not isinstance(error, MemoryError):
                raise
            complain(_words(error))
            if isinstance(error, OSError) and error.filename == STDOUT:
                _drop_stdout()
            sys.exit(1)


def _words(error: Exception) -> str:
    """Return an error in words; a refusal of the operating system is not called a defect."""
    if isinstance(error, MemoryError):
        return "not enough memory; use fewer or shorter bags"
    if isinstance(error, OSError):
        where = "" if error.filename is None else f"{error.filename}: "
        return f"{where}{error.strerror or error}"
    if isinstance(error, UnicodeEncodeError):
        part = error.object[error.start : error.end]
        word = next((word for word in error.object.split() if part in word), part)
        advice = "rename it" if error.encoding.startswith("utf") else "set PYTHONUTF8=1"
        return f"{word}: no name that can be written in {error.encoding}; {advice}"
    return (
        f"defect in idim_iv_ros ({type(error).__name__}: {error}); set "
        "IDIM_IV_TRACEBACK=1 and report what it prints"
    )


def _require_names(arguments: Sequence[str]) -> None:
    """Refuse an empty argument, and ``-`` as the name of a file."""
    for option, argument in pairwise(["", *arguments]):
        if not argument and option != "--namespace":
            raise UsageError("an argument is empty; is a variable of the shell not set?")
        if argument == "-" or argument.endswith("=-"):
            raise UsageError("-: name a file (./- if it has that name); --json prints results")


STDOUT = "stdout"  # in errors, in the place of the name of a file
_NARROWEST = 20  # columns in which words of the tables can be read


def prepare_streams() -> None:
    """Make stdout and stderr accept any text; a UsageError says that stdout is closed."""
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123, SIM115 - until the end
    if sys.stdout is None:
        raise UsageError("stdout is closed; send it to /dev/null if nobody reads it")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors=SPELT)
    for name in {"write", "flush"} - set(vars(sys.stdout)):
        setattr(sys.stdout, name, _naming_stdout(getattr(sys.stdout, name)))
    columns = os.environ.get("COLUMNS", "")
    if not (columns.isdecimal() and int(columns) >= _NARROWEST):
        os.environ.pop("COLUMNS", None)


def _drop_stdout() -> None:
    """Discard the buffered stdout, about which Python would complain at its exit."""
    devnull = os.open(os.devnull, os.O_WRONLY)
    os.dup2(devnull, sys.stdout.fileno())
    os.close(devnull)


def complain(text: str) -> None:
    """Print an error as one line on stderr."""
    from rich.console import Console
    from rich.text import Text

    line = Text.assemble(("idim-iv:", "bold red"), " ", " ".join(text.split()))
    Console(stderr=True, soft_wrap=True).print(line)


def _naming_stdout(write: Callable[..., object]) -> Callable[..., object]:
    def named(*arguments: object) -> object:
        try:
            return write(*arguments)
        except OSError as error:
            error.filename = STDOUT
            raise

    return named
