"""The launch files, which need `launch` of a ROS 2 installation to run (it is not on PyPI).

Which parameters launched nodes get: from arguments, from `params_file`, or from neither.
"""

import json
import os
import re
from dataclasses import MISSING, fields
from pathlib import Path

import pytest
import yaml
from ruamel.yaml import YAML

from idim_iv_interfaces.msg import Prediction
from tests.ros.launch_file import Launched, launch, launched_nodes
from tests.ros.node_alone import node_alone
from tests.ros.processes import ROOT, SETTINGS

TWO = ["identifier", "recorder"]
SIMULATED = [*TWO, "robot_simulator"]
ALL = ["collector", "predictor", *SIMULATED]
NODES = {"demo": ALL, "robot": TWO, "robots": TWO * 2}
GIVEN = {"configuration": "arm.yaml"}
REQUIRED = {"demo": {}, "robot": GIVEN, "robots": {"robots": "left,right", **GIVEN}}
OF_THE_SIMULATOR = {"controller": "robot_simulator", "start_delay": 60.0, "stale_after": 2.0}
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
    launched = launch(FILES[name], **REQUIRED[name], **everything)
    assert sorted(executable for executable, _ in launched.nodes) == sorted(NODES[name])
    for executable, node in launched.nodes:
        assert os.access(ROOT / "scripts" / executable, os.X_OK)
        types = {item.name: type(item.default) for item in fields(SETTINGS[executable])}
        assert node["name"] == executable
        (parameters,) = node["parameters"]
        if executable == "collector":
            assert parameters.items() >= OF_THE_SIMULATOR.items()
        given = {key: type(value) for key, value in parameters.items()}
        assert given.items() <= {"use_sim_time": bool, **types}.items()
        assert parameters["use_sim_time"] is True
        assert node["ros_arguments"] == ["--log-level", "debug"]
        assert node["output"] == "screen"
    recorder = next(node for executable, node in launched.nodes if executable == "recorder")
    assert recorder["parameters"][0]["bag_prefix"] == "2024"
    assert recorder["parameters"][0]["record"] is True
    identifier = next(node for executable, node in launched.nodes if executable == "identifier")
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


def test_robots_have_namespaces_and_folders_of_their_own() -> None:
    launched = launch(
        FILES["robots"], robots="left, right=ur.yaml", configuration="arm.yaml", simulate="true"
    )
    assert started(launched) == [
        f"{side}/{name}" for side in ("left", "right") for name in SIMULATED
    ]
    given = {f"{node['namespace']}/{name}": node["parameters"][0] for name, node in launched.nodes}
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
    launched = launched_nodes(FILES["robot"], **given, controller="arm_controller")
    assert sorted(launched) == ["collector", "identifier", "predictor", "recorder"]
    assert launched["collector"] == {"configuration": "arm.yaml", "controller": "arm_controller"}
    # The predictor looks where the identifier writes.
    nodes = launched_nodes(FILES["robots"], robots="left", **GIVEN, predict="true")
    for name in ("predictor", "identifier"):
        assert nodes[name]["output_directory"] == "results/left"


def test_what_to_do_next_with_a_collector_and_a_predictor() -> None:
    lines = launch(FILES["demo"], namespace="left").next_steps()
    assert [line for line in lines if not line.startswith("#")] == [
        "ros2 param set /left/collector allow_motion true",
        "ros2 action send_goal --feedback /left/collector/collect "
        'idim_iv_interfaces/action/Collect "{}"',
        "ros2 topic echo /left/identifier/result",
        "idim-iv watch --namespace left",
    ]
    lines = launch(FILES["robot"], **GIVEN, collect="true", predict="true").next_steps()
    assert lines[2].endswith('"{identify: true}"')  # nothing else would have it identified
    assert lines[-1] == "idim-iv watch"


def test_what_to_do_next_by_hand() -> None:
    by_hand = {"collect": "false", "predict": "false"}
    lines = launch(FILES["demo"], namespace="left", **by_hand).next_steps()
    assert lines[0] == "ros2 service call /left/recorder/start std_srvs/srv/Trigger"
    assert lines[1].startswith("ros2 service call /left/robot_simulator/move")
    assert lines[-1] == "ros2 topic echo /left/identifier/result"
    lines = launch(FILES["robot"], **GIVEN, autostart="false").next_steps()
    # Before it is activated it would refuse.
    assert lines[0] == "ros2 lifecycle set /identifier configure"
    assert lines[2] == "ros2 param set /identifier auto true"
    assert not any("robot_simulator" in line for line in lines)


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


@pytest.fixture
def mine(tmp_path: Path):
    """Write a file of parameters: text, or parameters by section."""

    def write(content: str | dict[str, dict[str, object]]) -> str:
        path = tmp_path / "my parameters.yaml"
        if not isinstance(content, str):
            sections = {name: {"ros__parameters": given} for name, given in content.items()}
            content = json.dumps(sections)
        path.write_text(content)
        return str(path)

    return write


def resolved(folder: Path, name: str, **arguments: str) -> dict[str, dict[str, object]]:
    """What rcl gives each node, from files as launch_ros writes them."""
    given = {}
    for executable, keywords in launch(FILES[name], **arguments).nodes:
        namespace = f"/{keywords['namespace']}".rstrip("/")
        full = f"{namespace}/{keywords['name']}"
        command = ["-r", f"__ns:={namespace or '/'}"]
        for number, layer in enumerate(keywords["parameters"]):
            path = folder / f"{number}.yaml"
            if isinstance(layer, dict):
                path.write_text(json.dumps({full: {"ros__parameters": layer}}))
            command += ["--params-file", str(path) if isinstance(layer, dict) else layer]
        declared = {"automatically_declare_parameters_from_overrides": True}
        with node_alone(executable, *command, start_parameter_services=False, **declared) as node:
            names = ("configuration", "bag_directory", "output_directory", "stale_after")
            given[full] = {
                name: node.get_parameter(name).value for name in names if node.has_parameter(name)
            }
    return given


def test_folders_of_several_robots_are_in_those_that_the_file_names(tmp_path, mine) -> None:
    content = {
        "/**": {"use_sim_time": False},
        "/**/recorder": {"bag_directory": "/data/my bags", "configuration": "other.yaml"},
        "/**/identifier": {"bag_directory": "/data/my bags"},
        "/right/identifier": {"output_directory": "/elsewhere"},
    }
    file = mine(content)
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


def test_collector_of_a_simulated_robot_waits_longer_unless_the_file_says_otherwise(
    tmp_path, mine
) -> None:
    simulated = {**GIVEN, "collect": "true", "simulate": "true"}
    assert resolved(tmp_path, "robot", **simulated)["/collector"]["stale_after"] == 2.0
    file = mine({"/**/collector": {"stale_after": 0.5, "configuration": "other.yaml"}})
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


@pytest.mark.parametrize("name", NODES)
def test_launch_file_is_loaded_by_launch(name: str) -> None:
    pytest.importorskip("launch_ros", reason="launch is part of a ROS 2 installation")
    from launch.launch_description_sources import get_launch_description_from_python_launch_file

    assert get_launch_description_from_python_launch_file(str(FILES[name])).entities


FILE = ROOT / "params" / "nodes.yaml"


@pytest.mark.parametrize("node", SETTINGS)
def test_file_lists_every_parameter_with_its_default(node: str) -> None:
    defaults = {
        item.name: list(item.default) if isinstance(item.default, tuple) else item.default
        for item in fields(SETTINGS[node])
    }
    if node in ("predictor", "robot_simulator"):
        assert defaults.pop("configuration") == ""  # must be given
    assert MISSING not in defaults.values()
    listed = YAML(typ="safe").load(FILE.read_text())[f"/**/{node}"]["ros__parameters"]
    lines = FILE.read_text().partition(f"/**/{node}:")[2].splitlines()
    for name in listed.keys() - {"use_sim_time"}:
        line = next(line for line in lines if line.strip().startswith(f"{name}:"))
        assert line.partition("# ")[2], f"{name} is not explained"
    # NaN, which means that there is no floor, is not equal to itself.
    assert repr(sorted(listed.items())) == repr(sorted({"use_sim_time": False, **defaults}.items()))
    assert {key: type(value) for key, value in listed.items()} == {
        "use_sim_time": bool,
        **{key: type(value) for key, value in defaults.items()},
    }


def test_groups_of_the_aggregator_hold_every_status() -> None:
    document = YAML(typ="safe").load((FILE.parent / "diagnostics_aggregator.yaml").read_text())
    groups = document["analyzers"]["ros__parameters"]
    words = {name: group["contains"] for name, group in groups.items() if name != "path"}

    def group(status: str) -> list[str]:
        return [name for name, parts in words.items() if any(word in status for word in parts)]

    for expected, *statuses in (
        ("recordings", "/recorder: recording", "/left/recorder: /left/joint_states"),
        ("predictions", "/predictor: prediction", "/left/predictor: joint_2"),
        ("identifications", "/identifier: drift", "/left/identifier: joint_2"),
    ):
        assert [group(status) for status in statuses] == [[expected]] * 2


FIELDS = set(Prediction.get_fields_and_field_types())
LAYOUTS = ROOT / "layouts"


@pytest.mark.parametrize(
    ("file", "curve"),
    [
        ("foxglove.json", r'"/predictor/prediction\.(\w+)\[[0-6]\]"'),
        ("plotjuggler.xml", r'<curve [^>]*name="/predictor/prediction/(\w+)\[[0-6]\]"'),
    ],
)
def test_layouts_plot_fields_of_the_message(file: str, curve: str) -> None:
    plotted = re.findall(curve, (LAYOUTS / file).read_text())
    assert len(plotted) == 4 * 7
    assert set(plotted) <= FIELDS


def test_rviz_shows_the_markers() -> None:
    document = yaml.safe_load((LAYOUTS / "residual.rviz").read_text())
    displays = document["Visualization Manager"]["Displays"]
    (markers,) = [display for display in displays if display["Class"].endswith("MarkerArray")]
    assert markers["Topic"]["Value"] == "/predictor/residual_markers"
    assert set(markers["Namespaces"]) == {"residual", "share"}
