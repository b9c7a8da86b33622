"""What of the nominal model is hard to believe, on the terminal."""

from collections.abc import Sequence

from rich.console import Console
from rich.markup import escape


def print_doubts(console: Console, doubts: Sequence[str]) -> None:
    """One line for each doubt."""
    for doubt in doubts:
        console.print(f"[yellow]Warning:[/] {escape(doubt)}", highlight=False, soft_wrap=True)
