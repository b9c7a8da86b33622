"""`idim-iv diagnose`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Protocol

import typer
from typer.core import TyperCommand

from idim_iv_ros.cli.arguments import (
    AsJson,
    Bags,
    Config,
    Force,
    OutOrJson,
    Picture,
    Quiet,
    Verbose,
)
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import GAP, REPORT

AGAINST = "--against"

if TYPE_CHECKING:
    from idim_iv_ros.cli.output import Output
    from idim_iv_ros.configuration import Configuration
    from idim_iv_ros.diagnosis.result import GapResult
    from idim_iv_ros.files import FilePath, FilePaths
    from idim_iv_ros.progress import Progress


class WithSets(TyperCommand):
    """A command whose `--against` takes all names up to the next option, as bags do."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Give each name behind `--against` an option of its own."""
        return super().parse_args(ctx, list(_each_against(args)))


def _each_against(args: Sequence[str]) -> Iterator[str]:
    behind = False
    for place, each in enumerate(args):
        if each == "--":
            yield from args[place:]
            return
        if each.startswith("-"):
            behind = each == AGAINST
            yield each
            continue
        if behind and args[place - 1] != AGAINST:
            yield AGAINST
        yield each


class Diagnose(Protocol):
    """The public function `diagnose`."""

    def __call__(
        self,
        bags: FilePaths,
        configuration: Configuration,
        *,
        without: Sequence[str] = (),
        against: FilePaths = (),
        nominal: FilePath | None = None,
        progress: Progress | None = None,
    ) -> GapResult:
        """Diagnose bags."""


def diagnose_command(
    bags: Bags,
    config: Config,
    out: OutOrJson = None,
    without: Annotated[
        list[str] | None,
        typer.Option(
            help="Leave an effect out of the catalogue, to see what is said without it; may be "
            "repeated.",
            metavar="EFFECT",
            show_default=False,
        ),
    ] = None,
    against: Annotated[
        list[Path] | None,
        typer.Option(
            AGAINST,
            help="Recordings of the same robot, or of a simulator of it, that may differ: say what "
            "changed from the others to them. Names up to the next option belong to it.",
            metavar="BAG...",
            show_default=False,
        ),
    ] = None,
    nominal: Annotated[
        Path | None,
        typer.Option(
            help="A result.json or gap.json of this robot whose base parameters take the place of "
            "the URDF's.",
            metavar="FILE.json",
            show_default=False,
        ),
    ] = None,
    picture: Picture = None,
    force: Force = False,
    quiet: Quiet = False,
    as_json: AsJson = False,
    verbose: Verbose = False,
) -> None:
    """Say where simulator and robot differ, which effect causes it, and how far the gap shrinks.

    Writes gap.json and report.html.

    Example: idim-iv diagnose run1.mcap run2.mcap --config ur5.yaml --out why

    What changed: idim-iv diagnose before.mcap --against after.mcap --config ur5.yaml --out changed
    """
    from idim_iv_ros.cli.output import Output
    from idim_iv_ros.diagnosis.diagnose import diagnose
    from idim_iv_ros.effects.registry import EFFECTS

    output = Output(quiet=quiet, as_json=as_json, verbose=verbose)
    run_diagnosis(
        bags,
        config,
        out,
        without or (),
        diagnose=diagnose,
        effects=EFFECTS,
        against=against or (),
        nominal=nominal,
        picture=picture,
        force=force,
        output=output,
    )


def run_diagnosis(
    bags: Sequence[Path],
    config: Path,
    out: Path | None,
    without: Sequence[str],
    *,
    diagnose: Diagnose,
    effects: Sequence[str],
    against: Sequence[Path] = (),
    nominal: Path | None = None,
    picture: Path | None = None,
    force: bool = False,
    output: Output | None = None,
) -> None:
    """Check the request, diagnose, write the files, print the tables.

    Parameters
    ----------
    diagnose
        What makes a `GapResult` of the bags.
    effects
        Names that `without` may hold.
    against
        Recordings that may differ from the bags.
    nominal
        Result whose base parameters are the nominal model.
    picture
        File of a picture of the summary, if one is wanted.

    Raises
    ------
    UsageError
        An effect that the catalogue does not have, or as `load_configuration`,
        `require_destination` and `require_picture`.
    """
    from idim_iv_ros.cli.diagnosis_tables import print_diagnosis
    from idim_iv_ros.cli.identify import print_physical
    from idim_iv_ros.cli.output import Output, report_warnings, require_destination
    from idim_iv_ros.configuration import load_configuration
    from idim_iv_ros.report import write_gap_report
    from idim_iv_ros.report.picture import require_picture, write_picture

    output = output or Output()
    for name in without:
        if name not in effects:
            raise UsageError(f"--without {name}: no such effect; there are {', '.join(effects)}")
    configuration = load_configuration(config)
    require_picture(picture, force=force)
    destination = require_destination(out, (GAP, REPORT), as_json=output.as_json, force=force)
    numbers = page = None
    with destination:
        left_out = tuple(dict.fromkeys(without))
        with output.progress() as progress:
            more: dict[str, Any] = {"against": list(against)} if against else {}
            if nominal is not None:
                more["nominal"] = nominal
            result = diagnose(bags, configuration, without=left_out, progress=progress, **more)
        if out is not None:
            with report_warnings():
                numbers, page = write_gap_report(result, out, force=force, config=config)
        if picture is not None:
            write_picture(result, picture)
    output.document(result.to_document())
    print_diagnosis(output.console, result, whole=output.verbose)
    print_physical(output, result, numbers, config)
    if page is not None:
        output.line(f"Report: {page}")
    elif numbers is not None:
        output.line(f"Numbers: {numbers}")
