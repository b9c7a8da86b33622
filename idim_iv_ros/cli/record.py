"""`idim-iv record`."""

import typer

from idim_iv_ros.cli.arguments import Config, Out
from idim_iv_ros.configuration import load_configuration
from idim_iv_ros.errors import UsageError


def record_command(config: Config, out: Out) -> None:
    """Record the topics of a robot into a new bag under --out until Ctrl-C.

    The node `recorder`, started at once; its services and topics are there as with ros2 run.

    Example: idim-iv record --config ur5.yaml --out bags
    """
    load_configuration(config)
    try:
        from idim_iv_ros.nodes.recorder import run
    except ModuleNotFoundError as error:
        raise UsageError(
            f"the Python package {error.name} is not installed: source a ROS 2 workspace with "
            "idim_iv_interfaces, or pip install '.[ros]' ./idim_iv_interfaces"
        ) from error
    parameters = {"configuration": config.resolve(), "bag_directory": out, "autostart": "true"}
    arguments = ["idim-iv", "--ros-args"]
    for name, value in parameters.items():
        arguments += ["-p", f"{name}:={value}"]
    raise typer.Exit(run(arguments))
