"""Tables that fit the terminal and never cut a name: where the columns do not fit, rows are blocks.

A column is never narrower than its longest word: the name of a joint or a parameter, or a number
with its unit (`unbroken`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from rich.text import Text

_GAP = 2  # spaces between columns
_LONGEST = 24  # rows that are printed without --verbose
_NOTHING = ("", "–")
_NO_BREAK = "\N{NO-BREAK SPACE}"


@dataclass(frozen=True)
class Column:
    """Heading and alignment of a column.

    Attributes
    ----------
    heading : str
    right : bool
        Aligned to the right: numbers.
    """

    heading: str
    right: bool = False


def unbroken(text: str) -> str:
    """Text that a table does not break at its spaces."""
    return text.replace(" ", _NO_BREAK)


def print_table(
    console: Console,
    title: str,
    columns: Sequence[Column],
    rows: Sequence[Sequence[str]],
    *,
    whole: bool = True,
    rest: str = "--verbose prints them",
) -> None:
    """Print rows of plain text under a title; columns that say nothing in any row are left out.

    Parameters
    ----------
    whole
        Print all rows; else the first 24, and how many there are besides.
    rest
        Where the other rows are.
    """
    said = [
        place
        for place in range(len(columns))
        if not rows or any(row[place] not in _NOTHING for row in rows)
    ]
    columns = [columns[place] for place in said]
    rows = [[row[place] for place in said] for row in rows]
    shown = rows if whole else rows[:_LONGEST]
    if title:
        console.print(Text(title, style="bold"))
    widths = _widths(columns, shown, console.width)
    if widths is None:
        _print_blocks(console, columns, shown)
    else:
        _print_columns(console, columns, shown, widths)
    if len(shown) < len(rows):
        console.print(Text(f"… and {len(rows) - len(shown)} more: {rest}", style="dim"))


def _widths(
    columns: Sequence[Column], rows: Sequence[Sequence[str]], available: int
) -> list[int] | None:
    """Width of each column, None where not even the longest words fit beside one another."""
    least, most = [], []
    for place, column in enumerate(columns):
        cells = [column.heading, *(row[place] for row in rows)]
        lines = [line for cell in cells for line in cell.split("\n")]
        words = [word for line in lines for word in line.split(" ")]
        most.append(max(map(cell_len, lines)))
        least.append(max(map(cell_len, words)))
    spare = available - sum(least) - _GAP * (len(columns) - 1)
    if spare < 0:
        return None
    widths = list(least)
    while spare and any(width < wish for width, wish in zip(widths, most, strict=True)):
        wanting = max(range(len(widths)), key=lambda k: most[k] / widths[k])
        widths[wanting] += 1
        spare -= 1
    return widths


def _print_columns(
    console: Console,
    columns: Sequence[Column],
    rows: Sequence[Sequence[str]],
    widths: Sequence[int],
) -> None:
    table = Table(box=None, padding=(0, _GAP, 0, 0), pad_edge=False, header_style="dim")
    for column, width in zip(columns, widths, strict=True):
        table.add_column(
            _text(_wrapped(column.heading, width)),
            width=width,
            no_wrap=True,
            justify="right" if column.right else "left",
        )
    for row in rows:
        cells = zip(row, widths, strict=True)
        table.add_row(*(_text(_wrapped(cell, width)) for cell, width in cells))
    console.print(table)


def _print_blocks(
    console: Console, columns: Sequence[Column], rows: Sequence[Sequence[str]]
) -> None:
    """The first cell of a row as a heading, the others under it as ``heading: value``."""
    width = max(console.width - 2, 1)
    for row in rows:
        if row[0]:
            console.print(_text([row[0].replace("\n", ", ")]), soft_wrap=True)
        for column, cell in zip(columns[1:], row[1:], strict=True):
            if cell:
                if "\n" in cell:
                    lines = [f"{column.heading}:"]
                    lines += [f"  {line}" for line in _wrapped(cell, width - 2)]
                else:
                    lines = _wrapped(f"{column.heading}: {cell}", width)
                console.print(_text([f"  {line}" for line in lines]), soft_wrap=True)


def _wrapped(cell: str, width: int) -> list[str]:
    """Lines of a cell, broken at spaces where they are longer than `width`."""
    lines = []
    for line in cell.split("\n"):
        current = ""
        for word in line.split(" "):
            longer = f"{current} {word}" if current else word
            if current and cell_len(longer) > width:
                lines.append(current)
                longer = word
            current = longer
        lines.append(current)
    return lines


def _text(lines: Sequence[str]) -> Text:
    return Text("\n".join(lines).replace(_NO_BREAK, " "))
