"""Where a command's words go: tables for people, one JSON document for programs, or nothing."""

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

from rich.console import Console
from rich.text import Text

from idim_iv_ros.cli.progress import Report, shown_progress
from idim_iv_ros.errors import UsageError


class Output:
    """Stdout and stderr of one command.

    Attributes
    ----------
    console : rich.console.Console
        Stdout for people; takes nothing with `quiet` or `as_json`.
    quiet, as_json, verbose : bool
        As the user asked.
    """

    def __init__(self, *, quiet: bool = False, as_json: bool = False, verbose: bool = False):
        self.quiet, self.as_json, self.verbose = quiet, as_json, verbose
        self.console = Console(quiet=quiet or as_json, highlight=False)

    def progress(self) -> AbstractContextManager[Report]:
        """Progress on stderr; it is gone, or stays as lines, when the work ends."""
        return shown_progress(self.quiet)

    def line(self, text: str) -> None:
        """Print text in which nothing is markup, unbroken: paths stay whole."""
        self.console.print(Text(text), soft_wrap=True)

    def warn_quietly(self, warnings: Iterable[str]) -> None:
        """Print warnings on stderr where the tables that hold them are not printed."""
        if self.console.quiet:
            self.warn(warnings)

    def warn(self, warnings: Iterable[str]) -> None:
        """Print warnings on stderr, whatever stdout is for."""
        for warning in warnings:
            print(f"Warning: {warning}", file=sys.stderr)

    def document(self, content: Mapping[str, object]) -> None:
        """Print the result for a program, if that was asked for."""
        if self.as_json:
            json.dump(content, sys.stdout, indent=2, ensure_ascii=False, allow_nan=False)
            sys.stdout.write("\n")
            sys.stdout.flush()


def require_destination(
    out: Path | None, names: Sequence[str], *, as_json: bool, force: bool
) -> AbstractContextManager[None]:
    """Make sure, before long work, that a result has somewhere to go.

    Raises
    ------
    UsageError
        Neither --out nor --json was given, or as `require_writable`.
    """
    if out is not None:
        from idim_iv_ros.report import require_writable

        return require_writable(out, names, force=force)
    if not as_json:
        raise UsageError("give --out FOLDER for the report, or --json for the result on stdout")
    return nullcontext()
