"""`idim-iv record` and `idim-iv serve`: ROS 2 nodes in the process of the command line."""

import importlib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer

from idim_iv_ros.cli.arguments import Config, Out
from idim_iv_ros.errors import UsageError


def record_command(config: Config, out: Out) -> None:
    """Record the topics of a robot into a new bag under --out until Ctrl-C.

    The node `recorder`, started at once; its services and topics are there as with ros2 run.

    Example: idim-iv record --config ur5.yaml --out bags
    """
    from idim_iv_ros.configuration import load_configuration

    load_configuration(config)
    parameters = {"configuration": config.resolve(), "bag_directory": out, "autostart": True}
    _start_node("recorder", parameters)


def serve_command(
    config: Config,
    out: Out,
    bags: Annotated[
        Path, typer.Option("--bags", help="Folder of the bags that may be asked for.")
    ] = Path(),
    auto: Annotated[
        bool, typer.Option("--auto", help="Identify every bag that the recorder closes.")
    ] = False,
) -> None:
    """Answer ROS 2 requests to identify bags until Ctrl-C.

    The node `identifier`; its services, actions and topics are there as with ros2 run.

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
    _start_node("identifier", parameters)


def _start_node(name: str, parameters: Mapping[str, object]) -> None:
    """Run a node of `idim_iv_ros.nodes` with parameters until a signal.

    Raises
    ------
    UsageError
        rclpy or the messages are not installed.
    typer.Exit
        With the exit status of the node.
    """
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
    raise typer.Exit(run(arguments))
