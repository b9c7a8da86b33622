"""The launch files, which need `launch` of a ROS 2 installation to run (it is not on PyPI)."""

import ast
import os
from dataclasses import fields
from pathlib import Path

import pytest

from idim_iv_ros.nodes.identifier_settings import IdentifierSettings
from idim_iv_ros.nodes.recorder_settings import RecorderSettings
from tests.ros.processes import ROOT

NODES = {"demo": ["identifier", "recorder", "robot_simulator"], "robot": ["identifier", "recorder"]}
PARAMETERS = {
    "recorder": {field.name for field in fields(RecorderSettings)},
    "identifier": {field.name for field in fields(IdentifierSettings)},
    "robot_simulator": {"configuration"},
}


def nodes(path: Path) -> dict[str, set[str]]:
    """Executable of each Node in a launch file, with the parameters that it is given."""
    found = {}
    for call in ast.walk(ast.parse(path.read_text())):
        if isinstance(call, ast.Call) and getattr(call.func, "id", "") == "Node":
            given = {keyword.arg: keyword.value for keyword in call.keywords}
            assert ast.literal_eval(given["package"]) == "idim_iv_ros"
            (parameters,) = given["parameters"].elts
            names = {ast.literal_eval(key) for key in parameters.keys}
            found[ast.literal_eval(given["executable"])] = names
    return found


@pytest.mark.parametrize("name", NODES)
def test_launch_file_starts_executables_that_exist_with_parameters_they_have(name: str) -> None:
    path = ROOT / "launch" / f"{name}.launch.py"
    compile(path.read_text(), path, "exec")
    found = nodes(path)
    assert sorted(found) == NODES[name]
    for executable, parameters in found.items():
        assert os.access(ROOT / "scripts" / executable, os.X_OK)
        assert parameters <= PARAMETERS[executable]


@pytest.mark.parametrize("name", NODES)
def test_launch_file_is_loaded_by_launch(name: str) -> None:
    pytest.importorskip("launch_ros", reason="launch is part of a ROS 2 installation")
    from launch.launch_description_sources import get_launch_description_from_python_launch_file

    path = ROOT / "launch" / f"{name}.launch.py"
    description = get_launch_description_from_python_launch_file(str(path))
    assert len(description.entities) > len(NODES[name])
