"""What a launch file starts, run with stand-ins for `launch`, which is not on PyPI."""

import runpy
import sys
from collections.abc import Callable, Iterator
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
    set, `arguments` the description and default of every argument that was declared, `handlers` who
    listens to the output of which node.
    """

    nodes: list[tuple[str, dict]] = field(default_factory=list)
    said: list[str] = field(default_factory=list)
    environment: dict[str, str | None] = field(default_factory=dict)
    arguments: dict[str, tuple[str, str | None]] = field(default_factory=dict)
    values: dict[str, str] = field(default_factory=dict)
    handlers: list[tuple[object, Callable]] = field(default_factory=list)

    def hear(self, number: int, text: str) -> None:
        """Take a part of what a node prints; nodes are numbered as they were started."""
        _, node = self.nodes[number]
        for target, handler in self.handlers:
            if target is node["action"]:
                _visit(handler(SimpleNamespace(text=text.encode())), self)

    def next_steps(self) -> list[str]:
        """Let all nodes be ready, the last one first, and return the lines for a shell."""
        assert not self.said
        for number in reversed(range(len(self.nodes))):
            self.hear(number, "[INFO] [1.5] [recorder]: rea")
            assert not self.said
            self.hear(number, "dy: it is\n")
            self.hear(number, "[INFO] [1.6] [recorder]: ready: again\n")
        (text,) = self.said
        return text.splitlines()[1:]


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
        return "".join(str(_text(item, launched)) for item in value)
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
            {key: _text(value, launched) for key, value in layer.items()}
            if isinstance(layer, dict)
            else str(_text(layer, launched))
            for layer in keywords["parameters"]
        ]
        launched.nodes.append((executable, {**keywords, "parameters": layers, "action": visit}))

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


def _on_output(*, target_action, on_stdout, on_stderr):
    assert on_stdout == on_stderr
    return target_action, on_stderr


def _configuration(name: str, default: str | None = None):
    def perform(launched: Launched) -> str:
        return launched.values[name] if default is None else launched.values.get(name, default)

    return _substitution(perform)


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
        "RegisterEventHandler": lambda handler: lambda launched: launched.handlers.append(handler),
        "SetEnvironmentVariable": lambda name, value: (
            lambda launched: launched.environment.update({name: value})
        ),
        "UnsetEnvironmentVariable": lambda name: (
            lambda launched: launched.environment.update({name: None})
        ),
    },
    "launch.event_handlers": {"OnProcessIO": _on_output},
    "launch.events": {},
    "launch.events.process": {"ProcessIO": object},
    "launch.launch_description_sources": {"PythonLaunchDescriptionSource": Path},
    "launch.substitutions": {
        "LaunchConfiguration": _configuration,
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
