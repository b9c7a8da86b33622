"""What a launch file starts, run with stand-ins for `launch`, which is not on PyPI."""

import runpy
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType, SimpleNamespace
from unittest.mock import patch

from tests.ros.processes import ROOT

Parameters = dict[str, object]


@dataclass
class Launched:
    """What the launch file asks for.

    `nodes` holds (executable, keywords of its Node), `said` what is logged, `environment` what is
    set, `arguments` the description and default of every argument that was declared.
    """

    nodes: list[tuple[str, dict]] = field(default_factory=list)
    said: list[str] = field(default_factory=list)
    environment: dict[str, str | None] = field(default_factory=dict)
    arguments: dict[str, tuple[str, str | None]] = field(default_factory=dict)
    values: dict[str, str] = field(default_factory=dict)


def launched_nodes(path: Path, **arguments: str) -> dict[str, Parameters]:
    """Parameters of each executable that a launch file starts once."""
    nodes = launch(path, **arguments).nodes
    assert len({executable for executable, _ in nodes}) == len(nodes)
    return {executable: node["parameters"][-1] for executable, node in nodes}


def launch(path: Path, **arguments: str) -> Launched:
    """Run a launch file with arguments."""
    launched = Launched(values=dict(arguments))
    with _stand_ins():
        _visit(_description(path), launched)
    return launched


def _description(path: Path) -> list:
    return runpy.run_path(str(path))["generate_launch_description"]()


def _text(value: object, launched: Launched) -> object:
    """Perform substitutions."""
    if isinstance(value, list):
        return "".join(str(_text(each, launched)) for each in value)
    perform = getattr(value, "perform", None)
    return value if perform is None else perform(SimpleNamespace(launched=launched))


def _visit(entities: list, launched: Launched) -> None:
    for entity in entities or ():
        if isinstance(entity, list):
            _visit(entity, launched)
            continue
        entity(launched)


def _declare(name: str, *, description: str, default_value: object = None):
    def visit(launched: Launched) -> None:
        default = None if default_value is None else str(_text(default_value, launched))
        launched.arguments.setdefault(name, (description, default))
        assert name in launched.values or default is not None, f"{name} is not given"
        launched.values.setdefault(name, default)

    return visit


def _node(*, package: str, executable: str, **keywords: object):
    def visit(launched: Launched) -> None:
        assert package == "idim_iv_ros"
        layers = [
            {key: _text(each, launched) for key, each in layer.items()}
            if isinstance(layer, dict)
            else str(_text(layer, launched))
            for layer in keywords["parameters"]
        ]
        launched.nodes.append((executable, {**keywords, "parameters": layers}))

    return visit


def _include(source: Path, *, launch_arguments: object = ()):
    def visit(launched: Launched) -> None:
        for name, value in launch_arguments:
            launched.values[name] = str(_text(value, launched))
        _visit(_description(source), launched)

    return visit


def _group(entities: list):
    def visit(launched: Launched) -> None:
        before = dict(launched.values)
        _visit(entities, launched)
        launched.values = before

    return visit


def _opaque(*, function):
    return lambda launched: _visit(function(SimpleNamespace(launched=launched)), launched)


def _substitution(perform):
    return SimpleNamespace(perform=lambda context: perform(context.launched))


def _parameter(value: object, *, value_type: type):
    assert value_type is str
    return _substitution(lambda launched: str(_text(value, launched)))


def _joined(parts: list):
    def perform(launched: Launched) -> str:
        return str(Path(*(str(_text(part, launched)) for part in parts)))

    return _substitution(perform)


# Only what launch and launch_ros of Jazzy have, with the arguments that they take.
NAMES = {
    "launch": {"LaunchContext": object, "LaunchDescription": list},
    "launch.actions": {
        "DeclareLaunchArgument": _declare,
        "GroupAction": _group,
        "IncludeLaunchDescription": _include,
        "LogInfo": lambda *, msg: lambda launched: launched.said.append(msg),
        "OpaqueFunction": _opaque,
        "SetEnvironmentVariable": lambda name, value: (
            lambda launched: launched.environment.update({name: value})
        ),
        "TimerAction": lambda *, period, actions: lambda launched: _visit(actions, launched),
        "UnsetEnvironmentVariable": lambda name: (
            lambda launched: launched.environment.update({name: None})
        ),
    },
    "launch.launch_description_sources": {"PythonLaunchDescriptionSource": Path},
    "launch.substitutions": {
        "LaunchConfiguration": lambda name: _substitution(lambda launched: launched.values[name]),
        "PathJoinSubstitution": _joined,
    },
    "launch_ros": {},
    "launch_ros.actions": {"Node": _node},
    "launch_ros.parameter_descriptions": {"ParameterValue": _parameter},
    "launch_ros.substitutions": {
        "FindPackageShare": lambda package: _substitution(lambda launched: str(ROOT))
    },
}


@contextmanager
def _stand_ins() -> Iterator[None]:
    modules = {}
    for name, content in NAMES.items():
        modules[name] = ModuleType(name)
        vars(modules[name]).update(content)
    with patch.dict(sys.modules, modules):
        yield
