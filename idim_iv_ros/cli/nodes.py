"""`idim-iv record`, `serve`, `predict`, `watch`: ROS 2 nodes in the process of the command line."""

import importlib
import json
import re
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Option

from idim_iv_ros.cli.output import Config, Out
from idim_iv_ros.errors import UsageError

_NAMESPACE = re.compile(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)
# What follows --ros-args is the node's.
ROS_ARGUMENTS = {"allow_extra_args": True, "ignore_unknown_options": True}
Namespace = Annotated[
    str, Option(help="ROS namespace of the node, and of the relative topics of the configuration.")
]
Result = Annotated[Path | None, Option(help="A result.json; left out: the newest of --results.")]
Results = Annotated[Path, Option(help="Folder in which `idim-iv serve` writes its results.")]


def record_command(
    context: typer.Context, config: Config, out: Out, namespace: Namespace = ""
) -> None:
    """Record the topics of a robot into a new bag under --out until Ctrl-C.

    The node `recorder`, started at once; its services and topics are there as with ros2 run.
    Arguments of ROS go last, behind --ros-args.

    Example: idim-iv record --config ur5.yaml --out bags --namespace left
    """
    _run("recorder", context, config, namespace, {"bag_directory": out, "record": True})


def serve_command(
    context: typer.Context,
    config: Config,
    out: Out,
    bags: Path = Option(Path(), help="Folder of the bags that may be asked for."),
    auto: bool = Option(False, "--auto", help="Identify every bag that the recorder closes."),
    namespace: Namespace = "",
) -> None:
    """Answer ROS 2 requests to identify bags until Ctrl-C.

    The node `identifier`; its services, actions and topics are there as with ros2 run. Arguments
    of ROS go last, behind --ros-args.

    Example: idim-iv serve --config ur5.yaml --bags bags --out results
    """
    parameters = {"bag_directory": bags, "output_directory": out, "auto": auto}
    _run("identifier", context, config, namespace, parameters)


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
    _run("predictor", context, config, namespace, _predictor_parameters(result, results))


def watch_command(
    context: typer.Context,
    config: Path | None = Option(
        None, help="The robot's YAML file: predict here, too; left out: show what `predict` says."
    ),
    result: Result = None,
    results: Results = Path("results"),
    web: int | None = Option(
        None,
        metavar="PORT",
        min=0,
        max=65535,
        help="Show a page on this port of this machine, and no table; 0: any free port.",
    ),
    namespace: Namespace = "",
) -> None:
    """Show measured and predicted efforts of a running robot until Ctrl-C.

    A table on the terminal, or with --web a page with live plots that only this machine can open.
    What recorder and identifier do is shown with it.

    Example: idim-iv watch --config ur5.yaml --result results/result.json --web 8080
    """
    if config is None and result is not None:
        raise UsageError("--result needs --config: the result is used where efforts are predicted")
    predictor = None if config is None else _node("predictor").Predictor
    parameters = {} if config is None else _predictor_parameters(result, results)
    _run("watch", context, config, namespace, parameters, web, predictor)


def _predictor_parameters(result: Path | None, results: Path) -> dict[str, object]:
    if result is not None and not result.is_file():
        raise UsageError(f"{result}: no such file; `idim-iv identify` writes one")
    places = {"output_directory": results, "result": result}
    return {name: place.resolve() for name, place in places.items() if place is not None}


def _run(
    name: str,
    context: typer.Context,
    config: Path | None,
    namespace: str,
    parameters: Mapping[str, object],
    *settings: object,
) -> None:
    if config is not None:
        from idim_iv_ros.configuration import load_configuration

        load_configuration(config)
        parameters = {"configuration": config.resolve(), **parameters}
    arguments = ros_arguments(namespace, parameters, context.args)
    raise typer.Exit(_node(name).run(arguments, *settings))


def _node(name: str) -> Any:
    """Import a module of a node, or raise UsageError with what is not installed."""
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
    """Return arguments of ROS for namespace and parameters, followed by those of the user."""
    if others and others[0] != "--ros-args":
        raise UsageError(f"no such option: {others[0]} (arguments of ROS go behind --ros-args)")
    for option, word in pairwise(others):
        name = word.partition(":=")[0].rpartition(":")[2]
        if option in ("-p", "--param") and name in parameters:
            raise UsageError(f"{word}: an option of the command sets the parameter {name}")
    arguments = ["idim-iv", "--ros-args"]
    for parameter, value in parameters.items():
        # Text in quotes: a folder may be called 2024, or true.
        quoted = json.dumps(value if isinstance(value, bool) else str(value), ensure_ascii=False)
        arguments += ["-p", f"{parameter}:={quoted}"]
    if namespace:
        if not _NAMESPACE.fullmatch(namespace):
            words = "letters, digits and _, no digit first, parts separated by /"
            raise UsageError(f"--namespace: {namespace!r} is none of ROS: {words}")
        arguments += ["-r", f"__ns:=/{namespace.strip('/')}"]
    return [*arguments, *others]
