"""`idim-iv record`, `serve`, `predict`, `watch`: ROS 2 nodes in the process of the command line."""

import importlib
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

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
    parameters = {**_robot(config), "bag_directory": out, "autostart": True}
    _run("recorder", namespace, parameters, context.args)


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
    folders = {"bag_directory": bags, "output_directory": out}
    _run("identifier", namespace, {**_robot(config), **folders, "auto": auto}, context.args)


Result = Annotated[
    Path | None,
    typer.Option(
        "--result", help="A result.json; left out: the newest of --results.", show_default=False
    ),
]
Results = Annotated[
    Path, typer.Option("--results", help="Folder in which `idim-iv serve` writes its results.")
]


def predict_command(
    context: typer.Context,
    config: Config,
    result: Result = None,
    results: Results = Path("results"),
    namespace: Namespace = "",
) -> None:
    """Predict the efforts of a running robot from the last identification until Ctrl-C.

    The node `predictor`; its topics are there as with ros2 run. `idim-iv watch` shows them.

    Example: idim-iv predict --config ur5.yaml --result results/result.json
    """
    _run("predictor", namespace, _prediction(config, result, results), context.args)


def watch_command(
    context: typer.Context,
    config: Annotated[
        Path | None,
        typer.Option(
            "--config",
            help="The robot's YAML file: predict here, too; left out: show what `predict` says.",
            show_default=False,
        ),
    ] = None,
    result: Result = None,
    results: Results = Path("results"),
    web: Annotated[
        int | None,
        typer.Option(
            "--web",
            metavar="PORT",
            min=0,
            max=65535,
            help="Show a page on this port of this machine, and no table; 0: any free port.",
            show_default=False,
        ),
    ] = None,
    namespace: Namespace = "",
) -> None:
    """Show measured and predicted efforts of a running robot until Ctrl-C.

    A table on the terminal, or with --web a page with live plots that only this machine can open.
    What recorder and identifier do is shown with it.

    Example: idim-iv watch --config ur5.yaml --result results/result.json --web 8080
    """
    if config is None and result is not None:
        raise UsageError("--result needs --config: the result is used where efforts are predicted")
    parameters: dict[str, object] = {}
    predictor = None
    if config is not None:
        parameters = _prediction(config, result, results)
        predictor = _node("predictor").Predictor
    _run("watch", namespace, parameters, context.args, web, predictor)


def _robot(config: Path) -> dict[str, object]:
    """Parameter that names the robot's file, which is refused here if it cannot be read."""
    from idim_iv_ros.configuration import load_configuration

    load_configuration(config)
    return {"configuration": config.resolve()}


def _prediction(config: Path, result: Path | None, results: Path) -> dict[str, object]:
    """Parameters of the predictor."""
    parameters = {**_robot(config), "output_directory": results.resolve()}
    if result is not None:
        if not result.is_file():
            raise UsageError(f"{result}: no such file; `idim-iv identify` writes one")
        parameters["result"] = result.resolve()
    return parameters


def _run(
    name: str,
    namespace: str,
    parameters: Mapping[str, object],
    others: Sequence[str],
    *settings: object,
) -> None:
    """Run a node of `idim_iv_ros.nodes` until a signal, and exit with its status.

    Parameters
    ----------
    name
    namespace
    parameters
        Of ROS, by name.
    others
        Arguments of ROS that the user gave.
    settings
        What the node takes besides arguments of ROS.

    Raises
    ------
    UsageError
        rclpy or the messages are not installed, or an argument is neither the command's nor ROS's.
    typer.Exit
    """
    arguments = ros_arguments(namespace, parameters, others)
    raise typer.Exit(_node(name).run(arguments, *settings))


def _node(name: str) -> Any:
    """Import a node, or say what is missing."""
    try:
        return importlib.import_module(f"idim_iv_ros.nodes.{name}.node")
    except ModuleNotFoundError as error:
        raise UsageError(
            f"the Python package {error.name} is not installed: source a ROS 2 workspace with "
            "idim_iv_interfaces, or pip install '.[ros]' ./idim_iv_interfaces"
        ) from error


def ros_arguments(
    namespace: str, parameters: Mapping[str, object], others: Sequence[str]
) -> list[str]:
    """Arguments of ROS that set the namespace and the parameters, and those of the user."""
    if others and others[0] != "--ros-args":
        raise UsageError(f"no such option: {others[0]} (arguments of ROS go behind --ros-args)")
    arguments = ["idim-iv", "--ros-args"]
    for parameter, value in parameters.items():
        # Text in quotes: a folder may be called 2024, or true.
        quoted = json.dumps(value if isinstance(value, bool) else str(value), ensure_ascii=False)
        arguments += ["-p", f"{parameter}:={quoted}"]
    if namespace:
        if not _NAMESPACE.fullmatch(namespace):
            raise UsageError(
                f"--namespace: {namespace!r} is none of ROS: letters, digits and _, no digit "
                "first, parts separated by /"
            )
        arguments += ["-r", f"__ns:=/{namespace.strip('/')}"]
    return [*arguments, *others]
