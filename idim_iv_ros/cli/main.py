"""The command `idim-iv`: arguments in, one public function, a short table out."""

import os
import sys

import typer
from rich.console import Console

from idim_iv_ros.cli.check import check_command
from idim_iv_ros.cli.diagnose import diagnose_command
from idim_iv_ros.cli.excite import excite_command
from idim_iv_ros.cli.identify import identify_command
from idim_iv_ros.cli.import_table import import_command
from idim_iv_ros.cli.record import record_command
from idim_iv_ros.cli.serve import serve_command
from idim_iv_ros.cli.simulate import simulate_command
from idim_iv_ros.errors import IdimError
from idim_iv_ros.foreign_warnings import silence_foreign_warnings

application = typer.Typer(
    name="idim-iv",
    help="Identify robot dynamics from ROS 2 recordings, test whether to believe the answer, and "
    "say why a simulator and its robot differ.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)
application.command("import")(import_command)
application.command("check")(check_command)
application.command("identify")(identify_command)
application.command("diagnose")(diagnose_command)
application.command("record")(record_command)
application.command("serve")(serve_command)
application.command("excite")(excite_command)
application.command("simulate")(simulate_command)


def main() -> None:
    """Run the command line; every failure is one line on stderr and an exit status.

    With ``IDIM_IV_TRACEBACK`` set in the environment, unexpected errors keep their traceback.
    """
    silence_foreign_warnings()
    console = Console(stderr=True, soft_wrap=True, highlight=False)
    try:
        application()
    except IdimError as error:
        console.print(f"[bold red]idim-iv:[/] {_one_line(error)}")
        sys.exit(error.exit_status)
    except KeyboardInterrupt:
        console.print("idim-iv: interrupted")
        sys.exit(130)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(1)
    except MemoryError:
        console.print("[bold red]idim-iv:[/] not enough memory; use fewer or shorter bags")
        sys.exit(1)
    except Exception as error:
        if os.environ.get("IDIM_IV_TRACEBACK"):
            raise
        console.print(
            f"[bold red]idim-iv:[/] defect in idim_iv_ros ({type(error).__name__}: "
            f"{_one_line(error)}); set IDIM_IV_TRACEBACK=1 and report what it prints"
        )
        sys.exit(1)


def _one_line(error: BaseException) -> str:
    text = " ".join(str(error).split())
    return text.replace("[", "\\[")
