"""What a command shows on stderr while it works."""

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

INTERVAL = 5.0  # s between lines where stderr is not a terminal

Report = Callable[[str, float], None]


@contextmanager
def shown_progress(quiet: bool = False) -> Iterator[Report]:
    """Show stage, share and time: a bar on a terminal, else a line every few seconds."""
    if quiet:
        yield lambda stage, share: None
        return
    with _bar() if sys.stderr.isatty() else _lines() as report:
        yield report


@contextmanager
def _bar() -> Iterator[Report]:
    columns = (TextColumn("{task.description:<28}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("loading", total=1.0)

        def report(stage: str, share: float) -> None:
            bar.update(task, description=stage, completed=share)

        yield report


@contextmanager
def _lines() -> Iterator[Report]:
    """A line after each interval, also where a stage says nothing for long."""
    begin, done = time.monotonic(), threading.Event()
    latest = ("loading", 0.0)

    def report(stage: str, share: float) -> None:
        nonlocal latest
        latest = (stage, share)

    def print_lines() -> None:
        while not done.wait(INTERVAL):
            stage, share = latest
            print(
                f"{time.monotonic() - begin:.0f} s: {stage}, {100.0 * share:.0f} %",
                file=sys.stderr,
                flush=True,
            )

    printer = threading.Thread(target=print_lines, daemon=True)
    printer.start()
    try:
        yield report
    finally:
        done.set()
        printer.join()
