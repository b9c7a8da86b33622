"""Arguments that commands share, and output: tables, one JSON document for programs, or nothing.

Nothing here or in the modules of the commands imports what computes or draws: `--help` and shell
completion load them all. Each command imports what it needs when it runs.
"""

import math
import re
import sys
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path
from textwrap import fill
from typing import Annotated, Any, TypeVar

from rich import progress as bars
from rich.cells import cell_len
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text
from typer import Argument, Option

from idim_iv_ros.encoding import json_text, shell_command
from idim_iv_ros.errors import ReportWarning, UsageError
from idim_iv_ros.files import REPORT
from idim_iv_ros.progress import Progress

Bags = Annotated[
    list[Path],
    Argument(help="MCAP files, rosbag2 folders or .db3 files of one robot."),
]
Config = Annotated[
    Path, Option("--config", help="The robot's YAML file; `idim-iv init` writes a first one.")
]
Out = Annotated[Path, Option("--out", help="Folder for the results.")]
OutOrJson = Annotated[
    Path | None, Option("--out", help="Folder for the results; may be left out with --json.")
]
Force = Annotated[bool, Option("--force", help="Replace files that idim_iv_ros did not write.")]
Quiet = Annotated[bool, Option("--quiet", "-q", help="Print nothing but warnings and errors.")]
AsJson = Annotated[
    bool, Option("--json", help="Print the result as JSON, and nothing else, on stdout.")
]
Verbose = Annotated[bool, Option("--verbose", "-v", help="Print long tables whole.")]

INTERVAL = 5.0  # s between lines where stderr is not a terminal
LONGEST = 24  # rows that are printed without --verbose
# What a command computes: one of `idim_iv_ros.report.write.Written`, which is not loaded here.
AnyResult = TypeVar("AnyResult", bound=Any)


def numbers(option: str, text: str) -> list[float]:
    """Return finite numbers from a text in which commas separate them."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError as error:
        raise UsageError(f"{option} {text}: numbers separated by commas are needed") from error
    if not all(map(math.isfinite, values)):
        raise UsageError(f"{option} {text}: finite numbers are needed")
    return values


class Output:
    """Stdout and stderr of one command; `console` is silent with `quiet` or `as_json`."""

    def __init__(self, *, quiet: bool = False, as_json: bool = False):
        self.as_json = as_json
        self.console = Console(quiet=quiet or as_json, highlight=False)
        self.progress = partial(shown_progress, quiet)

    def produce(
        self,
        compute: Callable[..., AnyResult],
        bags: Sequence[Path],
        config: Path,
        name: str,
        out: Path | None,
        *,
        force: bool,
        **options: Any,
    ) -> tuple[AnyResult, Path | None, Path | None]:
        """Compute a result of bags, write its numbers and its page, and print it as JSON if asked.

        `compute` takes bags, configuration, `options` and `progress`; the numbers are written to
        the file `name` in the folder `out`. Returns the result, and the paths of numbers and page,
        None without --out. Raises UsageError, before computing: files cannot be written, or there
        is no --out nor --json.
        """
        from idim_iv_ros.configuration import load_configuration
        from idim_iv_ros.report.write import require_writable, write_report

        numbers = page = None
        configuration, recordings = load_configuration(config), [*bags, *options.get("against", ())]
        if out is None and not self.as_json:
            raise UsageError("give --out FOLDER for the report, or --json for the result on stdout")
        with nullcontext() if out is None else require_writable(out, (name, REPORT), force=force):
            with self.progress() as progress:
                result = compute(bags, configuration, progress=progress, **options)
            if out is not None:
                with report_warnings():
                    numbers, page = write_report(
                        result, out, force=force, config=config, bags=recordings
                    )
        self.document(result.to_document())
        return result, numbers, page

    def name_files(self, numbers: Path | None, page: Path | None) -> None:
        """Print the path of the page that was written, else that of the numbers."""
        if page is not None:
            self.line(f"Report: {page}")
        elif numbers is not None:
            self.line(f"Numbers: {numbers}")

    def line(self, text: str) -> None:
        """Print text without markup and line breaks, so that paths stay whole."""
        self.console.print(Text(text), soft_wrap=True)

    def warn(self, warnings: Iterable[str]) -> None:
        """Print warnings among the tables; on stderr where these are not printed."""
        for warning in warnings:
            if self.console.quiet:
                print(f"Warning: {warning}", file=sys.stderr)
            else:
                self.console.print(Text.assemble(("Warning:", "yellow"), f" {warning}"))

    def document(self, content: Mapping[str, object]) -> None:
        """Print the result as JSON, if --json was given."""
        if self.as_json:
            sys.stdout.write(json_text(content, encoding=sys.stdout.encoding or "utf-8"))


@contextmanager
def shown_progress(quiet: bool = False) -> Iterator[Progress]:
    """Show stage, share and time on stderr: a progress bar, or a line every few seconds."""
    if quiet or not sys.stderr.isatty():
        yield (lambda stage, share: None) if quiet else _lines()
        return
    stage = bars.TextColumn("{task.description:<28}")
    columns = (stage, bars.BarColumn(), bars.TimeElapsedColumn())
    with bars.Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("loading", total=1.0)
        yield lambda stage, share: bar.update(task, description=stage, completed=share)


def _lines() -> Progress:
    begin = latest = time.monotonic()

    def report(stage: str, share: float) -> None:
        nonlocal latest
        now = time.monotonic()
        if now - latest >= INTERVAL:
            latest = now
            words = f"{now - begin:.0f} s: {stage}, {100.0 * share:.0f} %"
            print(words, file=sys.stderr, flush=True)

    return report


@contextmanager
def report_warnings() -> Iterator[None]:
    """Print each `ReportWarning` in the ``with`` block as one line on stderr."""
    console = Console(stderr=True, soft_wrap=True, highlight=False)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ReportWarning)
        yield
    for w in caught:
        if issubclass(w.category, ReportWarning):
            text = escape(" ".join(str(w.message).split()))
            console.print(f"[bold yellow]idim-iv: warning:[/] {text}")
        else:
            warnings.warn_explicit(w.message, w.category, w.filename, w.lineno)


def next_command(command: str, bags: Sequence[Path | str], config: Path, *options: str) -> str:
    """Return ``idim-iv COMMAND BAG… --config FILE OPTIONS``."""
    words = [command, *map(str, bags), "--config", str(config), *options]
    return f"idim-iv {shell_command(*words)}"


def print_table(
    console: Console,
    title: str,
    columns: Sequence[str],
    rows: Sequence[Sequence[str]],
    *,
    most: int | None = None,
    rest: str = "--verbose prints them",
) -> None:
    """Print rows of plain text under a title; columns that are empty in all rows are left out.

    Headings of numbers begin with ``>``. Only texts are wrapped where the terminal is narrow, for
    which rich needs the least width of every column. Of more than `most` rows the first are
    printed, and how many others there are; `rest` says where.
    """
    shown = rows[:most]
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="dim")
    contents, least = [], -2
    for place, heading in enumerate(columns):
        if rows and all(row[place] in ("", "–") for row in rows):
            continue
        cells, words = [row[place] for row in shown], heading.removeprefix(">")
        unbroken = words != heading or not any(" " in cell for cell in cells)
        parts = re.split("\n" if unbroken else r"\s", "\n".join([*cells, *words.split()]))
        width = max(map(cell_len, parts))
        table.add_column(
            fill(words, width) if unbroken else words,
            justify="left" if words == heading else "right",
            min_width=width,
            no_wrap=unbroken,
        )
        contents.append(map(Text, cells))
        least += width + 2
    for row in zip(*contents, strict=True):
        table.add_row(*row)
    if title:
        console.print(Text(title, style="bold"))
    table.width = least if least > console.width else None
    console.print(table, crop=False)
    if len(shown) < len(rows):
        console.print(Text(f"… and {len(rows) - len(shown)} more: {rest}", style="dim"))
