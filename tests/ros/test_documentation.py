"""What the pages on ROS 2 name is what is there."""

import re

import pytest

from tests.ros.processes import ROOT


def test_readme_installs_every_dependency_for_a_ros_installation() -> None:
    tomllib = pytest.importorskip("tomllib")  # Python 3.11
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    needed = {re.split(r"[<>=]", item)[0] for item in project["dependencies"]}
    (command,) = re.findall(
        r'^pip install "numpy<2" (.*?[^\\])$',
        (ROOT / "README.md").read_text(),
        flags=re.MULTILINE | re.DOTALL,
    )
    assert set(command.replace("\\", "").split()) | {"numpy"} == needed
