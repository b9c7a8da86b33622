"""The files of parameters that are installed beside the launch files."""

import json
import re
from dataclasses import MISSING, fields
from xml.etree import ElementTree

import pytest
import yaml
from ruamel.yaml import YAML

from idim_iv_interfaces.msg import Prediction
from idim_iv_ros.nodes.parameters import Settings, declare
from idim_iv_ros.nodes.settings import RecorderSettings
from tests.ros.node_alone import node_alone
from tests.ros.processes import ROOT, SETTINGS

FILE = ROOT / "params" / "nodes.yaml"


def section(node: str) -> dict[str, object]:
    document = YAML(typ="safe").load(FILE.read_text())
    return document[f"/**/{node}"]["ros__parameters"]


@pytest.mark.parametrize("node", SETTINGS)
def test_file_lists_every_parameter_with_its_default(node: str) -> None:
    defaults = {
        item.name: list(item.default) if isinstance(item.default, tuple) else item.default
        for item in fields(SETTINGS[node])
    }
    if node in ("predictor", "robot_simulator"):
        assert defaults.pop("configuration") == ""  # must be given
    assert MISSING not in defaults.values()
    listed = section(node)
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


def settings_of(kind: type[Settings], *arguments: str) -> Settings:
    """Of a node in the namespace /left."""
    with node_alone("recorder", "-r", "__ns:=/left", *arguments) as node:
        return declare(node, kind)


def test_file_is_for_nodes_in_any_namespace_and_arguments_win(tmp_path) -> None:
    mine = tmp_path / "mine.yaml"
    mine.write_text(FILE.read_text().replace("bag_prefix: recording", "bag_prefix: mine"))
    given = ["--params-file", str(mine)]
    assert settings_of(RecorderSettings, *given).bag_prefix == "mine"
    assert settings_of(RecorderSettings, *given, "-p", "bag_prefix:=other").bag_prefix == "other"


def test_groups_of_the_aggregator_hold_every_status() -> None:
    document = YAML(typ="safe").load((FILE.parent / "diagnostics_aggregator.yaml").read_text())
    groups = document["analyzers"]["ros__parameters"]
    words = {name: group["contains"] for name, group in groups.items() if name != "path"}

    def group(status: str) -> list[str]:
        return [name for name, parts in words.items() if any(word in status for word in parts)]

    for status in ("/recorder: recording", "/left/recorder: /left/joint_states"):
        assert group(status) == ["recordings"]
    for status in ("/predictor: prediction", "/left/predictor: joint_2"):
        assert group(status) == ["predictions"]
    for status in ("/identifier: drift", "/left/identifier: joint_2"):
        assert group(status) == ["identifications"]


FIELDS = set(Prediction.get_fields_and_field_types())
LAYOUTS = ROOT / "layouts"


def panels(node: object) -> set[str]:
    if isinstance(node, str):
        return {node}
    return panels(node["first"]) | panels(node["second"])


def test_foxglove_shows_every_panel_that_it_describes() -> None:
    layout = json.loads((LAYOUTS / "foxglove.json").read_text())
    assert panels(layout["layout"]) == set(layout["configById"])
    paths = [
        path["value"] for panel in layout["configById"].values() for path in panel.get("paths", [])
    ]
    assert len(paths) == 4 * 7
    for path in paths:
        topic, field = path.rsplit(".", 1)
        assert topic == "/predictor/prediction"
        assert re.sub(r"\[[0-6]\]$", "", field) in FIELDS


def test_plotjuggler_names_fields_of_the_message() -> None:
    root = ElementTree.parse(LAYOUTS / "plotjuggler.xml").getroot()
    assert root.find("previouslyLoaded_Streamer").get("name") == "ROS2 Topic Subscriber"
    for splitter in root.iter("DockSplitter"):
        assert int(splitter.get("count")) == len(splitter.findall("DockArea"))
        assert len(splitter.get("sizes").split(";")) == int(splitter.get("count"))
    curves = [curve.get("name") for curve in root.iter("curve")]
    assert len(curves) == 4 * 7
    for curve in curves:
        match = re.fullmatch(r"/predictor/prediction/(\w+)\[[0-6]\]", curve)
        assert match and match[1] in FIELDS


def test_rviz_shows_the_markers() -> None:
    document = yaml.safe_load((LAYOUTS / "residual.rviz").read_text())
    displays = document["Visualization Manager"]["Displays"]
    (markers,) = [display for display in displays if display["Class"].endswith("MarkerArray")]
    assert markers["Topic"]["Value"] == "/predictor/residual_markers"
    assert set(markers["Namespaces"]) == {"residual", "share"}
