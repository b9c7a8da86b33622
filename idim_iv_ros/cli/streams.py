"""Stdout and stderr of the command: any text, any width, and one line if nobody takes it."""

import os
import sys
from collections.abc import Callable
from io import TextIOWrapper

from idim_iv_ros.encoding import SPELT
from idim_iv_ros.errors import UsageError

STDOUT = "stdout"  # in errors, in the place of the name of a file
_NARROWEST = 20  # columns in which words of the tables can be read


def prepare_streams() -> None:
    """Make stdout and stderr take whatever is printed.

    Raises UsageError: stdout is closed.
    """
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123, SIM115 - until the end
    if sys.stdout is None:
        raise UsageError("stdout is closed; send it to /dev/null if nobody reads it")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors=SPELT)
    for name in {"write", "flush"} - set(vars(sys.stdout)):
        setattr(sys.stdout, name, _naming(STDOUT, getattr(sys.stdout, name)))
    columns = os.environ.get("COLUMNS", "")
    if not (columns.isdecimal() and int(columns) >= _NARROWEST):
        os.environ.pop("COLUMNS", None)


def drop_stdout() -> None:
    """Let what still waits for stdout go nowhere: Python would complain of it at its end."""
    devnull = os.open(os.devnull, os.O_WRONLY)
    os.dup2(devnull, sys.stdout.fileno())
    os.close(devnull)


def complain(text: str) -> None:
    """Print what went wrong as one line on stderr."""
    from rich.console import Console
    from rich.text import Text

    line = Text.assemble(("idim-iv:", "bold red"), " ", " ".join(text.split()))
    Console(stderr=True, soft_wrap=True).print(line)


def _naming(name: str, write: Callable[..., object]) -> Callable[..., object]:
    """Return the same function, whose errors say which file it is of."""

    def named(*arguments: object) -> object:
        try:
            return write(*arguments)
        except OSError as error:
            error.filename = name
            raise

    return named
