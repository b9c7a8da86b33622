"""The launch files, which need `launch` of a ROS 2 installation to run (it is not on PyPI)."""

import os
from dataclasses import fields

import pytest

from idim_iv_ros.nodes.collector.settings import CollectorSettings
from idim_iv_ros.nodes.identifier.settings import IdentifierSettings
from idim_iv_ros.nodes.predictor.settings import PredictorSettings
from idim_iv_ros.nodes.recorder.settings import RecorderSettings
from idim_iv_ros.nodes.simulator.node import SimulatorSettings
from tests.ros.launch_file import Launched, launch, launched_nodes
from tests.ros.processes import ROOT

TWO = ["identifier", "recorder"]
SIMULATED = [*TWO, "robot_simulator"]
ALL = ["collector", "predictor", *SIMULATED]
NODES = {"demo": ALL, "robot": TWO, "robots": TWO * 2}
GIVEN = {"configuration": "arm.yaml"}
REQUIRED = {"demo": {}, "robot": GIVEN, "robots": {"robots": "left,right", **GIVEN}}
PARAMETERS = {
    "recorder": RecorderSettings,
    "identifier": IdentifierSettings,
    "predictor": PredictorSettings,
    "collector": CollectorSettings,
    "robot_simulator": SimulatorSettings,
}
OF_THE_SIMULATOR = {"controller": "robot_simulator", "start_delay": 60.0}
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
        *before, parameters = node["parameters"]
        assert before == ([OF_THE_SIMULATOR] if executable == "collector" else [])
        assert set(OF_THE_SIMULATOR) <= {each.name for each in fields(CollectorSettings)}
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
    assert started(found) == [f"{side}/{name}" for side in ("left", "right") for name in SIMULATED]
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


def test_collector_and_predictor_are_started_on_request() -> None:
    given = {**GIVEN, "namespace": "left", "predict": "true", "collect": "true"}
    found = launch(FILES["robot"], **given, controller="arm_controller", params_file="mine.yaml")
    layers = {executable: node["parameters"] for executable, node in found.nodes}
    assert sorted(layers) == ["collector", "identifier", "predictor", "recorder"]
    own = {"configuration": "arm.yaml", "controller": "arm_controller"}
    assert layers["collector"] == ["mine.yaml", own]
    # A simulated robot is the controller, unless a file of parameters names another one.
    found = launch(FILES["robot"], **given, simulate="true", params_file="mine.yaml")
    layers = {executable: node["parameters"] for executable, node in found.nodes}
    assert layers["collector"] == [OF_THE_SIMULATOR, "mine.yaml", {"configuration": "arm.yaml"}]
    # The predictor looks where the identifier writes.
    found = launch(FILES["robots"], robots="left", **GIVEN, predict="true")
    results = {
        executable: node["parameters"][0].get("output_directory")
        for executable, node in found.nodes
    }
    assert results["predictor"] == results["identifier"] == "results/left"


def test_what_to_do_next_with_a_collector_and_a_predictor() -> None:
    said = launch(FILES["demo"], namespace="left").said
    assert said[0].startswith("next: ros2 param set /left/collector allow_motion true")
    assert said[1].endswith('/left/collector/collect idim_iv_interfaces/action/Collect "{}"')
    assert said[2].startswith("ros2 topic echo /left/identifier/result")
    assert said[3] == "idim-iv watch --namespace left"
    said = launch(FILES["robot"], **GIVEN, collect="true", predict="true").said
    assert said[1].endswith('"{identify: true}"')  # nothing else would have it identified
    assert said[-1] == "idim-iv watch"


def test_what_to_do_next_names_what_the_nodes_offer() -> None:
    by_hand = {"collect": "false", "predict": "false"}
    said = launch(FILES["demo"], namespace="left", **by_hand).said
    assert said[0] == "next: ros2 service call /left/recorder/start std_srvs/srv/Trigger"
    assert any("/left/robot_simulator/move" in line for line in said)
    assert said[-1].startswith("ros2 topic echo /left/identifier/result")
    said = launch(FILES["robot"], **GIVEN, autostart="false").said
    # Before it is activated it would refuse.
    assert said[0] == "next: ros2 lifecycle set /identifier configure"
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
