"""`idim-iv record` and `idim-iv serve`: ROS 2 nodes in the process of the command line."""

import importlib
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

import typer

from idim_iv_ros.cli.arguments import Config, Out
from idim_iv_ros.errors import UsageError

_NAMESPACE = re.compile(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)
# What follows --ros-args is the node's.
ROS_ARGUMENTS = {"allow_extra_args": True, "ignore_unknown_options": True}
Namespace = Annotated[
    str,
    typer.Option(
        help="ROS namespace of the node, and of the relative topics of the configuration.",
        show_default=False,
    ),
]


def record_command(
    context: typer.Context, config: Config, out: Out, namespace: Namespace = ""
) -> None:
    """Record the topics of a robot into a new bag under --out until Ctrl-C.

    The node `recorder`, started at once; its services and topics are there as with ros2 run.
    Arguments of ROS go last, behind --ros-args.

    Example: idim-iv record --config ur5.yaml --out bags --namespace left
    """
    from idim_iv_ros.configuration import load_configuration

    load_configuration(config)
    parameters = {"configuration": config.resolve(), "bag_directory": out, "autostart": True}
    _start_node("recorder", namespace, parameters, context.args)


def serve_command(
    context: typer.Context,
    config: Config,
    out: Out,
    bags: Annotated[
        Path, typer.Option("--bags", help="Folder of the bags that may be asked for.")
    ] = Path(),
    auto: Annotated[
        bool, typer.Option("--auto", help="Identify every bag that the recorder closes.")
    ] = False,
    namespace: Namespace = "",
) -> None:
    """Answer ROS 2 requests to identify bags until Ctrl-C.

    The node `identifier`; its services, actions and topics are there as with ros2 run. Arguments
    of ROS go last, behind --ros-args.

    Example: idim-iv serve --config ur5.yaml --bags bags --out results
    """
    from idim_iv_ros.configuration import load_configuration

    load_configuration(config)
    parameters = {
        "configuration": config.resolve(),
        "bag_directory": bags,
        "output_directory": out,
        "auto": auto,
    }
    _start_node("identifier", namespace, parameters, context.args)


def _start_node(
    name: str, namespace: str, parameters: Mapping[str, object], others: Sequence[str]
) -> None:
    """Run a node of `idim_iv_ros.nodes` with parameters, and arguments of ROS, until a signal.

    Raises
    ------
    UsageError
        rclpy or the messages are not installed, or an argument is neither the command's nor ROS's.
    typer.Exit
        With the exit status of the node.
    """
    if others and others[0] != "--ros-args":
        raise UsageError(f"no such option: {others[0]} (arguments of ROS go behind --ros-args)")
    try:
        run = importlib.import_module(f"idim_iv_ros.nodes.{name}.node").run
    except ModuleNotFoundError as error:
        raise UsageError(
            f"the Python package {error.name} is not installed: source a ROS 2 workspace with "
            "idim_iv_interfaces, or pip install '.[ros]' ./idim_iv_interfaces"
        ) from error
    arguments = ["idim-iv", "--ros-args"]
    for parameter, value in parameters.items():
        text = str(value).lower() if isinstance(value, bool) else str(value)
        arguments += ["-p", f"{parameter}:={text}"]
    if namespace:
        if not _NAMESPACE.fullmatch(namespace):
            raise UsageError(
                f"--namespace: {namespace!r} is none of ROS: letters, digits and _, no digit "
                "first, parts separated by /"
            )
        arguments += ["-r", f"__ns:=/{namespace.strip('/')}"]
    raise typer.Exit(run([*arguments, *others]))
