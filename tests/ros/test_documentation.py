"""What the pages on ROS 2 name is what is there."""

import re
from dataclasses import fields

import pytest

from idim_iv_ros.nodes.settings import (
    CollectorSettings,
    IdentifierSettings,
    RecorderSettings,
    SimulatorSettings,
)
from tests.ros.processes import ROOT


@pytest.mark.parametrize(
    "kind", [RecorderSettings, IdentifierSettings, CollectorSettings, SimulatorSettings]
)
def test_every_parameter_is_explained(kind: type) -> None:
    node = kind.__name__.replace("Settings", "").lower()
    (section,) = re.findall(
        rf"^## (?:robot_)?{node}$(.*?)(?=^## |\Z)",
        (ROOT / "docs" / "ros.md").read_text(),
        flags=re.MULTILINE | re.DOTALL,
    )
    named = set(re.findall(r"(?<![~\w])(\w+)", section))
    assert {field.name for field in fields(kind)} - named == set()


def test_readme_installs_every_dependency_for_a_ros_installation() -> None:
    tomllib = pytest.importorskip("tomllib")  # Python 3.11
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    needed = {re.split(r"[<>=]", each)[0] for each in project["dependencies"]}
    (command,) = re.findall(
        r'^pip install "numpy<2" (.*?[^\\])$',
        (ROOT / "README.md").read_text(),
        flags=re.MULTILINE | re.DOTALL,
    )
    assert set(command.replace("\\", "").split()) | {"numpy"} == needed
