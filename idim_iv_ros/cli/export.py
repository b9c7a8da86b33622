"""`idim-iv export`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from idim_iv_ros.cli import arguments as shared
from idim_iv_ros.cli.output import Output, next_command


def export_command(
    result: Annotated[
        Path,
        Argument(
            metavar="RESULT.json|GAP.json",
            help="What `idim-iv identify` or `idim-iv diagnose` wrote.",
        ),
    ],
    config: shared.Config,
    out: shared.Out,
    refit: bool = Option(
        False,
        "--refit",
        help="Of a diagnosis all parameters of its refit, not the named causes alone.",
    ),
    without: list[str] | None = Option(
        None,
        metavar="CAUSE[@JOINT]",
        help="Leave out a named cause, for example payload; may be given again.",
    ),
    remainder: bool = Option(
        False,
        "--remainder",
        help="Spread what no cause explains over links and joints, as far as the recording "
        "asks for it.",
    ),
    randomize: bool = Option(
        False,
        "--randomize",
        help="The same, and ranges for domain randomisation: sample(model, rng) for MuJoCo.",
    ),
    force: shared.Force = False,
    quiet: shared.Quiet = False,
    as_json: shared.AsJson = False,
) -> None:
    """Write a result as URDF, MuJoCo model, effects, Isaac Lab actuators and a table of changes.

    Of a diagnosis: the URDF of the configuration with the named causes, a payload as a link of its
    own; of an identification: with its inertials, damping and friction. Nothing else changes. With
    robot.mjcf it is that MJCF, with armature too. Neither is written over.

    Example: idim-iv export why/gap.json --config ur5.yaml --out simulator
    """
    from idim_iv_ros.configuration import load_configuration
    from idim_iv_ros.simulator_files import export

    output = Output(quiet=quiet, as_json=as_json)
    made = export(
        result,
        load_configuration(config),
        out,
        force=force,
        refit=refit,
        without=without or (),
        remainder=remainder,
        randomize=randomize,
    )
    files = [str(file) for file in made.files]
    notes, missing = list(made.notes), list(made.not_native)
    output.document({"files": files, "not_native": missing, "notes": notes})
    for note in notes:
        output.line(f"Note: {note}")
    if missing:
        why = "MuJoCo has no element for" if made.urdf else "Your MJCF was not given elements for"
        output.line(
            f"{why} {', '.join(missing)}: {made.effects.name} holds "
            "them for its loop (docs/simulators.md)"
        )
    for file in files:
        output.line(f"Written: {file}")
    output.line(f"What is new, and how sure it is: {made.changes}")
    # A result has the names of its recordings alone: they are looked for where it lies.
    folders = (Path(), *result.parents)
    bags = [
        next((folder / name for folder in folders if (folder / name).exists()), Path(name))
        for name in made.bags
    ]
    options = ("--model", str(made.mjcf), "--effects", str(made.effects), "--out", "replayed")
    output.line(f"Next: {next_command('replay', bags, config, *options)}")
