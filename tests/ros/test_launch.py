"""The launch files, which need `launch` of a ROS 2 installation to run (it is not on PyPI)."""

import os
from dataclasses import fields

import pytest

from idim_iv_ros.nodes.identifier.settings import IdentifierSettings
from idim_iv_ros.nodes.recorder.settings import RecorderSettings
from idim_iv_ros.nodes.simulator.node import SimulatorSettings
from tests.ros.launch_file import Launched, launch, launched_nodes
from tests.ros.processes import ROOT

ALL = ["identifier", "recorder", "robot_simulator"]
NODES = {"demo": ALL, "robot": ALL[:2], "robots": ALL[:2] * 2}
GIVEN = {"configuration": "arm.yaml"}
REQUIRED = {"demo": {}, "robot": GIVEN, "robots": {"robots": "left,right", **GIVEN}}
PARAMETERS = {
    "recorder": RecorderSettings,
    "identifier": IdentifierSettings,
    "robot_simulator": SimulatorSettings,
}
FILES = {name: ROOT / "launch" / f"{name}.launch.py" for name in NODES}


def started(launched: Launched) -> list[str]:
    """Full names of the nodes."""
    return sorted(f"{node['namespace']}/{name}".lstrip("/") for name, node in launched.nodes)


@pytest.mark.parametrize("name", NODES)
def test_launch_file_starts_executables_that_exist_with_parameters_they_have(name: str) -> None:
    everything = {
        "bags": "b", "results": "r", "bag_prefix": "2024", "record": "true", "auto": "true",
        "autostart": "false", "use_sim_time": "True", "log_level": "debug", "namespace": "cell",
    }  # fmt: skip
    found = launch(FILES[name], **REQUIRED[name], **everything)
    assert sorted(executable for executable, _ in found.nodes) == sorted(NODES[name])
    for executable, node in found.nodes:
        assert os.access(ROOT / "scripts" / executable, os.X_OK)
        types = {each.name: type(each.default) for each in fields(PARAMETERS[executable])}
        (parameters,) = node["parameters"]
        given = {key: type(value) for key, value in parameters.items()}
        assert given.items() <= {"use_sim_time": bool, **types}.items()
        assert parameters["use_sim_time"] is True
        assert node["ros_arguments"] == ["--log-level", "debug"]
        assert node["output"] == "screen"
    recorder = next(node for executable, node in found.nodes if executable == "recorder")
    assert recorder["parameters"][0]["bag_prefix"] == "2024"
    assert recorder["parameters"][0]["autostart"] is True
    identifier = next(node for executable, node in found.nodes if executable == "identifier")
    assert identifier["parameters"][0]["autostart"] is False


def test_what_is_not_given_is_left_to_the_nodes() -> None:
    assert launched_nodes(FILES["robot"], **GIVEN) == {
        "recorder": {"configuration": "arm.yaml", "bag_directory": "bags"},
        "identifier": {
            "configuration": "arm.yaml",
            "bag_directory": "bags",
            "output_directory": "results",
        },
    }
    demo = launched_nodes(FILES["demo"])
    assert demo["identifier"]["auto"] is True
    assert demo["robot_simulator"] == {"configuration": str(ROOT / "config" / "arm2.yaml")}


def test_a_file_of_parameters_gives_way_to_arguments_only() -> None:
    found = launch(FILES["robot"], **GIVEN, params_file="mine.yaml", results="elsewhere")
    layers = {executable: node["parameters"] for executable, node in found.nodes}
    assert layers["recorder"] == ["mine.yaml", {"configuration": "arm.yaml"}]
    assert layers["identifier"] == [
        "mine.yaml",
        {"configuration": "arm.yaml", "output_directory": "elsewhere"},
    ]


def test_robots_have_namespaces_and_folders_of_their_own() -> None:
    found = launch(
        FILES["robots"], robots="left, right=ur.yaml", configuration="arm.yaml", simulate="true"
    )
    assert started(found) == [f"{side}/{name}" for side in ("left", "right") for name in ALL]
    given = {f"{node['namespace']}/{name}": node["parameters"][0] for name, node in found.nodes}
    assert given["left/recorder"] == {"configuration": "arm.yaml", "bag_directory": "bags/left"}
    assert given["right/identifier"] == {
        "configuration": "ur.yaml",
        "bag_directory": "bags/right",
        "output_directory": "results/right",
    }
    one = launch(FILES["robot"], **GIVEN, namespace="/left")
    assert started(one) == ["left/identifier", "left/recorder"]
    assert one.nodes[1][1]["parameters"][0]["output_directory"] == "results/left"


@pytest.mark.parametrize(
    ("name", "arguments", "words"),
    [
        ("robot", {**GIVEN, "auto": "yes"}, "argument auto: 'yes' is neither true nor false"),
        ("robots", {"robots": "left"}, "left has no YAML file"),
        ("robots", {"robots": "left,left", **GIVEN}, "has no name, or one twice"),
        ("robots", {"robots": "left,", **GIVEN}, "has no name, or one twice"),
    ],
)
def test_wrong_arguments_are_one_line(name: str, arguments: dict[str, str], words: str) -> None:
    with pytest.raises(RuntimeError, match=words) as refused:
        launch(FILES[name], **arguments)
    assert "\n" not in str(refused.value)


def test_what_to_do_next_names_what_the_nodes_offer() -> None:
    said = launch(FILES["demo"], namespace="left").said
    assert said[0] == "next: ros2 service call /left/recorder/start std_srvs/srv/Trigger"
    assert any("/left/robot_simulator/move" in line for line in said)
    assert said[-1].startswith("ros2 topic echo /left/identifier/result")
    said = launch(FILES["robot"], **GIVEN, autostart="false").said
    assert "ros2 lifecycle set /identifier configure" in said
    assert not any("robot_simulator" in line for line in said)
    assert said[-1].startswith("ros2 service call /identifier/identify")


def test_every_argument_is_described_in_the_documentation() -> None:
    page = (ROOT / "docs" / "ros.md").read_text().partition("## Launch files")[2]
    for name, arguments in REQUIRED.items():
        for argument, (about, _) in launch(FILES[name], **arguments).arguments.items():
            assert about
            assert f"`{argument}`" in page, argument


def test_demo_discovers_on_this_machine_only() -> None:
    assert launch(FILES["demo"]).environment == {
        "ROS_LOCALHOST_ONLY": None,
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    }


@pytest.mark.parametrize("name", NODES)
def test_launch_file_is_loaded_by_launch(name: str) -> None:
    pytest.importorskip("launch_ros", reason="launch is part of a ROS 2 installation")
    from launch.launch_description_sources import get_launch_description_from_python_launch_file

    description = get_launch_description_from_python_launch_file(str(FILES[name]))
    assert description.entities
