"""`idim-iv record`."""

from idim_iv_ros.cli.arguments import Config, Out
from idim_iv_ros.cli.start_node import start_node


def record_command(config: Config, out: Out) -> None:
    """Record the topics of a robot into a new bag under --out until Ctrl-C.

    The node `recorder`, started at once; its services and topics are there as with ros2 run.

    Example: idim-iv record --config ur5.yaml --out bags
    """
    from idim_iv_ros.configuration import load_configuration

    load_configuration(config)
    parameters = {"configuration": config.resolve(), "bag_directory": out, "autostart": True}
    start_node("recorder", parameters)
