"""The commands and the options that belong to none of them."""

import sys
from typing import Any

import typer
from typer import rich_utils

from idim_iv_ros.cli import identify, init, nodes, simulators
from idim_iv_ros.cli.diagnose import WithSets, diagnose_command
from idim_iv_ros.cli.excite import excite_command
from idim_iv_ros.cli.fleet import fleet
from idim_iv_ros.cli.main import complain

application = typer.Typer(
    name="idim-iv",
    help="Identify robot dynamics from ROS 2 recordings, test whether to believe the answer, and "
    "say why a simulator and its robot differ. Begin with `idim-iv init BAG --urdf FILE`.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)
application.command("init")(init.init_command)
application.command("check")(identify.check_command)
application.command("identify")(identify.identify_command)
application.command("compare")(identify.compare_command)
application.command("diagnose", cls=WithSets)(diagnose_command)
application.command("servo")(identify.servo_command)
application.command("export")(simulators.export_command)
application.command("import")(init.import_command)
application.command("record", context_settings=nodes.ROS_ARGUMENTS)(nodes.record_command)
application.command("serve", context_settings=nodes.ROS_ARGUMENTS)(nodes.serve_command)
application.command("predict", context_settings=nodes.ROS_ARGUMENTS)(nodes.predict_command)
application.command("watch", context_settings=nodes.ROS_ARGUMENTS)(nodes.watch_command)
application.command("excite")(excite_command)
application.command("simulate")(simulators.simulate_command)
application.command("replay")(simulators.replay_command)
application.add_typer(fleet, name="fleet")

_show = rich_utils.rich_format_error


def _show_error(error: Any) -> None:
    """Print an error in an option; for a missing configuration, also how to make one."""
    cause = error.__cause__
    if type(cause).__name__ == "ValidationError":  # recent versions of typer: pydantic's words
        from idim_iv_ros.validation import first_problem

        error.message = first_problem(cause)
    _show(error)
    options = error.ctx.command.params if getattr(error, "ctx", None) else ()
    needed = any(option.name == "config" and option.required for option in options)
    if needed and not any(argument.startswith("--config") for argument in sys.argv):
        complain("`idim-iv init BAG… --urdf FILE` writes a first file for --config")


setattr(rich_utils, "rich_format_error", _show_error)  # noqa: B010 - mypy


def _print_version(wanted: bool) -> None:
    if wanted:
        from idim_iv_ros import __version__

        typer.echo(f"idim-iv {__version__}")
        raise typer.Exit()


@application.callback()
def _options(
    version: bool = typer.Option(
        False,
        "--version",
        callback=_print_version,
        is_eager=True,
        help="Print the version and exit.",
    ),
) -> None:
    pass
