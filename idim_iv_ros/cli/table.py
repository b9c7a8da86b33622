"""Tables that fit the terminal and never cut a name: where the columns do not fit, rows are blocks.

A column is never narrower than its longest word: the name of a joint or a parameter, or a number
with its unit (`unbroken`).
"""

from collections.abc import Sequence
from textwrap import TextWrapper

from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from rich.text import Text

_GAP = 2  # spaces between columns
_LONGEST = 24  # rows that are printed without --verbose
_NOTHING = ("", "–")
_NO_BREAK = "\N{NO-BREAK SPACE}"  # no white space for textwrap


def unbroken(text: str) -> str:
    """Text that a table does not break at its spaces."""
    return text.replace(" ", _NO_BREAK)


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

    Parameters
    ----------
    columns
        Headings; ``>`` in front of one aligns its column to the right.
    whole
        Print all rows; else the first 24, and how many there are besides.
    rest
        Where the other rows are.
    """
    filled = [
        place
        for place in range(len(columns))
        if not rows or any(row[place] not in _NOTHING for row in rows)
    ]
    headings = [columns[place].removeprefix(">") for place in filled]
    cells = [[row[place] for place in filled] for row in (rows if whole else rows[:_LONGEST])]
    if title:
        console.print(Text(title, style="bold"))
    widths = _widths(list(zip(headings, *cells, strict=True)), console.width)
    if widths is None:
        _print_blocks(console, headings, cells)
    else:
        table = Table(box=None, padding=(0, _GAP, 0, 0), pad_edge=False, header_style="dim")
        for place, heading, width in zip(filled, headings, widths, strict=True):
            right = columns[place].startswith(">")
            text = _wrapped(heading, width)
            table.add_column(text, width=width, justify="right" if right else "left")
        for row in cells:
            table.add_row(*map(_wrapped, row, widths))
        console.print(table)
    if len(cells) < len(rows):
        console.print(Text(f"… and {len(rows) - len(cells)} more: {rest}", style="dim"))


def _widths(columns: Sequence[Sequence[str]], available: int) -> list[int] | None:
    """Width of each column, None where not even the longest words fit side by side."""
    lines = [[line for cell in column for line in cell.split("\n")] for column in columns]
    widths = [
        max(cell_len(word) for line in column for word in line.split(" ")) for column in lines
    ]
    wishes = [max(map(cell_len, column)) for column in lines]
    spare = available - sum(widths) - _GAP * (len(columns) - 1)
    if spare < 0:
        return None
    for _ in range(min(spare, sum(wishes) - sum(widths))):
        narrowest = max(range(len(widths)), key=lambda k: wishes[k] / widths[k])
        widths[narrowest] += 1
    return widths


def _print_blocks(console: Console, headings: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """The first cell of a row as a heading, the others under it as ``heading: value``."""
    width = max(console.width - 2, 1)
    for first, *others in rows:
        if first:
            console.print(_plain(first.replace("\n", ", ")), soft_wrap=True)
        for heading, cell in zip(headings[1:], others, strict=True):
            if cell:
                block = _wrapped(f"{heading}: {cell}", width)
                if "\n" in cell:
                    block = _plain(f"{heading}:\n{_wrapped(cell, width - 2, indent='  ')}")
                for line in block.plain.split("\n"):
                    console.print(Text(f"  {line}"), soft_wrap=True)


def _wrapped(cell: str, width: int, indent: str = "") -> Text:
    """Cell broken at spaces where a line of it is longer than `width`."""
    wrap = TextWrapper(width, break_long_words=False, break_on_hyphens=False).wrap
    return _plain(
        "\n".join(indent + part for line in cell.split("\n") for part in wrap(line) or [""])
    )


def _plain(text: str) -> Text:
    return Text(text.replace(_NO_BREAK, " "))
