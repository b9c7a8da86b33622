"""`idim-iv diagnose`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from typer import Option
from typer.core import TyperCommand

from idim_iv_ros.cli import output as shared
from idim_iv_ros.cli.identify import print_physical
from idim_iv_ros.cli.output import Output
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import GAP

AGAINST = "--against"


class WithSets(TyperCommand):
    """A command whose option `--against` takes all names up to the next option."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments after repeating `--against` before every name that belongs to it."""
        return super().parse_args(ctx, list(separated_sets(args)))


def separated_sets(arguments: Sequence[str]) -> Iterator[str]:
    """Yield the arguments with `--against` repeated before every name that belongs to it."""
    belongs = False
    for place, argument in enumerate(arguments):
        if argument == "--":
            yield from arguments[place:]
            return
        if argument.startswith("-"):
            belongs = argument == AGAINST
        elif belongs and arguments[place - 1] != AGAINST:
            yield AGAINST
        yield argument


def diagnose_command(
    bags: shared.Bags,
    config: shared.Config,
    out: shared.OutOrJson = None,
    without: list[str] | None = Option(
        None,
        metavar="EFFECT",
        help="Leave an effect out of the catalogue, to see what is said without it; "
        "may be repeated.",
    ),
    against: list[Path] | None = Option(
        None,
        AGAINST,
        metavar="BAG...",
        help="Recordings of the same robot, or of a simulator of it, that may differ: "
        "say what changed from the others to them. Names up to the next option "
        "belong to it.",
    ),
    force: shared.Force = False,
    quiet: shared.Quiet = False,
    as_json: shared.AsJson = False,
) -> None:
    """Say where simulator and robot differ, which effect causes it, and how far the gap shrinks.

    Writes gap.json and report.html.

    Example: idim-iv diagnose run1.mcap run2.mcap --config ur5.yaml --out why

    What changed: idim-iv diagnose before.mcap --against after.mcap --config ur5.yaml --out changed
    """
    from idim_iv_ros.cli.diagnosis_tables import print_diagnosis
    from idim_iv_ros.diagnosis.diagnose import diagnose
    from idim_iv_ros.effects.registry import EFFECTS
    from idim_iv_ros.report.advice import export_options

    output = Output(quiet=quiet, as_json=as_json)
    names = tuple(dict.fromkeys(without or ()))
    for name in names:
        if name not in EFFECTS:
            raise UsageError(f"--without {name}: no such effect; there are {', '.join(EFFECTS)}")
    result, numbers, page = output.produce(
        diagnose, bags, config, GAP, out, force=force, without=names, against=against or []
    )
    print_diagnosis(output.console, result)
    print_physical(output, result, numbers, config, *export_options(result))
    output.name_files(numbers, page)
