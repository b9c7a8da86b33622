"""Tables of one command: rich's, without columns that say nothing, and not too long."""

import re
from collections.abc import Sequence
from textwrap import fill

from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from rich.text import Text

LONGEST = 24  # rows that are printed without --verbose


def print_table(
    console: Console,
    title: str,
    columns: Sequence[str],
    rows: Sequence[Sequence[str]],
    *,
    most: int | None = None,
    rest: str = "--verbose prints them",
) -> None:
    """Print rows of plain text under a title; columns that say nothing in any row are left out.

    A heading that begins with ``>`` stands over numbers with their units, aligned to the right.
    Names and numbers stay on one line: only texts are broken where the terminal is narrow, for
    which rich wants the least width of every column. Of more than `most` rows the first are
    printed, how many are left, and in the words of `rest` where they are.
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
