"""Which parameters launched nodes get: from arguments, from `params_file`, or from neither."""

import json
from pathlib import Path

import pytest
import rclpy
from rclpy.node import Node

from tests.ros.launch_file import launch
from tests.ros.processes import ROOT

FILES = {name: ROOT / "launch" / f"{name}.launch.py" for name in ("robot", "robots")}
GIVEN = {"configuration": "arm.yaml"}


@pytest.fixture
def mine(tmp_path: Path):
    """Write a file of parameters."""

    def write(text: str) -> str:
        path = tmp_path / "my parameters.yaml"
        path.write_text(text)
        return str(path)

    return write


def section(name: str, **parameters: object) -> str:
    return json.dumps({name: {"ros__parameters": parameters}})[1:-1] + "\n"


def resolved(folder: Path, name: str, **arguments: str) -> dict[str, dict[str, object]]:
    """What rcl gives each node, from files as launch_ros writes them."""
    given = {}
    for executable, keywords in launch(FILES[name], **arguments).nodes:
        namespace = f"/{keywords['namespace']}".rstrip("/")
        full = f"{namespace}/{keywords['name']}"
        command = ["--ros-args", "-r", f"__ns:={namespace or '/'}"]
        for number, layer in enumerate(keywords["parameters"]):
            path = folder / f"{number}.yaml"
            if isinstance(layer, dict):
                path.write_text(json.dumps({full: {"ros__parameters": layer}}))
            command += ["--params-file", str(path) if isinstance(layer, dict) else layer]
        context = rclpy.Context()
        rclpy.init(args=command, context=context)
        try:
            node = Node(
                executable,
                context=context,
                automatically_declare_parameters_from_overrides=True,
                start_parameter_services=False,
            )
            names = ("configuration", "bag_directory", "output_directory", "stale_after")
            given[full] = {
                name: node.get_parameter(name).value for name in names if node.has_parameter(name)
            }
            node.destroy_node()
        finally:
            context.try_shutdown()
    return given


def test_folders_of_several_robots_are_in_those_that_the_file_names(tmp_path, mine) -> None:
    file = mine(
        "{"
        + ",".join(
            [
                section("/**", use_sim_time=False),
                section("/**/recorder", bag_directory="/data/my bags", configuration="other.yaml"),
                section("/**/identifier", bag_directory="/data/my bags"),
                section("/right/identifier", output_directory="/elsewhere"),
            ]
        )
        + "}"
    )
    given = resolved(tmp_path, "robots", robots="left,right", **GIVEN, params_file=file)
    for side, results in (("left", "results/left"), ("right", "/elsewhere")):
        bags = f"/data/my bags/{side}"
        assert given[f"/{side}/recorder"] == {"configuration": "arm.yaml", "bag_directory": bags}
        assert given[f"/{side}/identifier"] == {
            "configuration": "arm.yaml",
            "bag_directory": bags,
            "output_directory": results,
        }
    given = resolved(tmp_path, "robots", robots="left", **GIVEN, params_file=file, bags="x")
    assert given["/left/recorder"]["bag_directory"] == "x/left"


def test_file_with_all_defaults_gives_each_robot_folders_of_its_own(tmp_path) -> None:
    file = str(ROOT / "params" / "nodes.yaml")
    given = resolved(tmp_path, "robots", robots="left,right", **GIVEN, params_file=file)
    assert given["/right/recorder"] == {"configuration": "arm.yaml", "bag_directory": "right"}
    assert given["/left/identifier"]["output_directory"] == "results/left"


def test_one_robot_has_the_folders_that_the_file_names(tmp_path, mine) -> None:
    file = mine("left: {recorder: {ros__parameters: {bag_directory: /data/1}}}")
    one = {**GIVEN, "namespace": "left", "params_file": file}
    given = resolved(tmp_path, "robot", **one)
    assert given["/left/recorder"]["bag_directory"] == "/data/1"
    assert given["/left/identifier"]["output_directory"] == "results/left"
    given = resolved(tmp_path, "robot", **one, bags="elsewhere")
    assert given["/left/recorder"]["bag_directory"] == "elsewhere"


def test_collector_of_a_simulated_robot_waits_longer_unless_the_file_says_otherwise(
    tmp_path, mine
) -> None:
    simulated = {**GIVEN, "collect": "true", "simulate": "true"}
    assert resolved(tmp_path, "robot", **simulated)["/collector"]["stale_after"] == 2.0
    file = mine(f"{{{section('/**/collector', stale_after=0.5, configuration='other.yaml')}}}")
    given = resolved(tmp_path, "robot", **simulated, params_file=file)
    assert given["/collector"] == {"configuration": "arm.yaml", "stale_after": 0.5}
    given = resolved(tmp_path, "robot", **GIVEN, collect="true")
    assert given["/collector"] == GIVEN  # of a real robot the node's own, strict default


@pytest.mark.parametrize("text", ["{", "/**:\n\t- x", None])
def test_file_that_cannot_be_read_is_one_line(mine, text) -> None:
    file = mine(text) if text else "missing.yaml"
    with pytest.raises(RuntimeError, match="argument params_file: cannot read") as refused:
        launch(FILES["robot"], **GIVEN, params_file=file)
    assert "\n" not in str(refused.value)
