"""A ROS 2 node in the process of the command line."""

import importlib
from collections.abc import Mapping

import typer

from idim_iv_ros.errors import UsageError


def start_node(name: str, parameters: Mapping[str, object]) -> None:
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
