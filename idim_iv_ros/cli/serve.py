"""`idim-iv serve`."""

from pathlib import Path
from typing import Annotated

import typer

from idim_iv_ros.cli.arguments import Config, Out
from idim_iv_ros.cli.start_node import start_node


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
    start_node("identifier", parameters)
