"""The launch files, which need `launch` of a ROS 2 installation to run (it is not on PyPI)."""

import ast
import os
from dataclasses import fields

import pytest

from idim_iv_ros.nodes.identifier.settings import IdentifierSettings
from idim_iv_ros.nodes.recorder.settings import RecorderSettings
from idim_iv_ros.nodes.simulator.node import SimulatorSettings
from tests.ros.launch_file import launched_nodes
from tests.ros.processes import ROOT

NODES = {"demo": ["identifier", "recorder", "robot_simulator"], "robot": ["identifier", "recorder"]}
PARAMETERS = {
    "recorder": RecorderSettings,
    "identifier": IdentifierSettings,
    "robot_simulator": SimulatorSettings,
}


@pytest.mark.parametrize("name", NODES)
def test_launch_file_starts_executables_that_exist_with_parameters_they_have(name: str) -> None:
    path = ROOT / "launch" / f"{name}.launch.py"
    compile(path.read_text(), path, "exec")
    found = launched_nodes(path, configuration="arm.yaml")
    assert sorted(found) == NODES[name]
    for executable, parameters in found.items():
        assert os.access(ROOT / "scripts" / executable, os.X_OK)
        types = {each.name: type(each.default) for each in fields(PARAMETERS[executable])}
        assert {key: type(value) for key, value in parameters.items()}.items() <= types.items()


def test_defaults_of_the_arguments_are_what_the_nodes_get() -> None:
    nodes = launched_nodes(ROOT / "launch" / "robot.launch.py", configuration="arm.yaml")
    assert nodes["recorder"] == {"configuration": "arm.yaml", "bag_directory": "bags"}
    assert nodes["identifier"]["bag_directory"] == "bags"
    assert nodes["identifier"]["auto"] is False
    demo = launched_nodes(ROOT / "launch" / "demo.launch.py", configuration="arm.yaml")
    assert demo["identifier"]["auto"] is True


def test_demo_discovers_on_this_machine_only() -> None:
    text = (ROOT / "launch" / "demo.launch.py").read_text()
    calls = [each for each in ast.walk(ast.parse(text)) if isinstance(each, ast.Call)]
    settings = [
        tuple(ast.literal_eval(argument) for argument in call.args)
        for call in calls
        if getattr(call.func, "id", "") == "SetEnvironmentVariable"
    ]
    assert settings == [("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")]


@pytest.mark.parametrize("name", NODES)
def test_launch_file_is_loaded_by_launch(name: str) -> None:
    pytest.importorskip("launch_ros", reason="launch is part of a ROS 2 installation")
    from launch.launch_description_sources import get_launch_description_from_python_launch_file

    path = ROOT / "launch" / f"{name}.launch.py"
    description = get_launch_description_from_python_launch_file(str(path))
    assert len(description.entities) > len(NODES[name])
