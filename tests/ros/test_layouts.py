"""Layouts for Foxglove, PlotJuggler and RViz name topics and fields that there are."""

import json
import re
from xml.etree import ElementTree

import yaml

from idim_iv_interfaces.msg import Prediction
from tests.ros.processes import ROOT

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
