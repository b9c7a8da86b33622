"""Arguments and progress that several commands share."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

Bags = Annotated[
    list[Path],
    typer.Argument(
        help="MCAP files, rosbag2 folders or .db3 files of one robot.", show_default=False
    ),
]
Config = Annotated[
    Path, typer.Option("--config", help="The robot's YAML file.", show_default=False)
]
Out = Annotated[Path, typer.Option("--out", help="Folder for the results.", show_default=False)]


@contextmanager
def progress_bar() -> Iterator[Callable[[str, float], None]]:
    """Show stage, share and time on stderr while a command works; gone when it ends."""
    columns = (TextColumn("{task.description:<28}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=1.0)

        def report(stage: str, share: float) -> None:
            bar.update(task, description=stage, completed=share)

        yield report
