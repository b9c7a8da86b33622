"""Tables of one command: rich's, without columns that say nothing, and not too long."""

import re
from collections.abc import Sequence
from textwrap import fill
from typing import Literal

from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from rich.text import Text

_LONGEST = 24  # rows that are printed without --verbose


def print_table(
    console: Console,
    title: str,
    columns: Sequence[str],
    rows: Sequence[Sequence[str]],
    *,
    whole: bool = True,
    rest: str = "--verbose prints them",
) -> None:
    """Print rows of plain text under a title; columns that say nothing in any row are left out.

    Names and numbers stay on one line: only texts are broken where the terminal is narrow.

    Parameters
    ----------
    columns
        Headings; ``>`` in front of one says that numbers with their units are under it, which are
        aligned to the right.
    whole
        Print all rows; else the first 24, and how many there are besides.
    rest
        Where the other rows are.
    """
    shown = rows if whole else rows[:_LONGEST]
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="dim")
    contents, least = [], -2
    for place, heading in enumerate(columns):
        if rows and all(row[place] in ("", "–") for row in rows):
            continue
        cells = [row[place] for row in shown]
        words = heading.removeprefix(">")
        justify: Literal["left", "right"] = "left" if words == heading else "right"
        unbroken = words != heading or not any(" " in cell for cell in cells)
        parts = re.split("\n" if unbroken else r"\s", "\n".join([*cells, *words.split()]))
        width = max(map(cell_len, parts))
        words = fill(words, width) if unbroken else words
        table.add_column(words, justify=justify, min_width=width, no_wrap=unbroken)
        contents.append(cells)
        least += width + 2
    for row in zip(*contents, strict=True):
        table.add_row(*map(Text, row))
    if title:
        console.print(Text(title, style="bold"))
    table.width = least if least > console.width else None
    console.print(table, crop=False)
    if len(shown) < len(rows):
        console.print(Text(f"… and {len(rows) - len(shown)} more: {rest}", style="dim"))
