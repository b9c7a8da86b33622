"""What a report could not show, as lines on stderr."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

from rich.console import Console
from rich.markup import escape

from idim_iv_ros.errors import ReportWarning


@contextmanager
def report_warnings() -> Iterator[None]:
    """Print each `ReportWarning` as one line on stderr; others as they were before."""
    console = Console(stderr=True, soft_wrap=True, highlight=False)
    with warnings.catch_warnings():
        otherwise = warnings.showwarning

        def show(
            message: Warning | str,
            category: type[Warning],
            filename: str,
            lineno: int,
            file: TextIO | None = None,
            line: str | None = None,
        ) -> None:
            if issubclass(category, ReportWarning):
                text = escape(" ".join(str(message).split()))
                console.print(f"[bold yellow]idim-iv: warning:[/] {text}")
            else:
                otherwise(message, category, filename, lineno, file, line)

        warnings.showwarning = show
        warnings.simplefilter("always", ReportWarning)
        yield
