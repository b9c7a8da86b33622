"""Versions agree wherever they stand, and colcon sees two packages side by side in a clone."""

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
VERSION = re.search(r'^version = "(.+)"$', (ROOT / "pyproject.toml").read_text(), re.M)


@pytest.mark.parametrize("folder", ["ros", "idim_iv_interfaces"])
def test_a_ros_package_has_what_a_release_needs(folder: str) -> None:
    package = ElementTree.parse(ROOT / folder / "package.xml").getroot()
    assert VERSION is not None
    assert package.findtext("version") == VERSION[1]
    assert f"\n{VERSION[1]} (" in (ROOT / folder / "CHANGELOG.rst").read_text()
    (licence,) = package.findall("license")
    assert (ROOT / folder / licence.attrib["file"]).read_text().lstrip().startswith("Apache")
    project = f"project({package.findtext('name')}"
    assert project in (ROOT / folder / "CMakeLists.txt").read_text()


def test_colcon_takes_the_root_for_no_package() -> None:
    for name in ("package.xml", "setup.py", "setup.cfg", "CMakeLists.txt", "COLCON_IGNORE"):
        assert not (ROOT / name).exists()


def test_what_the_ros_package_installs_is_there() -> None:
    text = (ROOT / "ros" / "CMakeLists.txt").read_text()
    (folders,) = re.findall(r"foreach\(folder ([a-z ]+)\)", text)
    for folder in ("idim_iv_ros", "scripts", *folders.split()):
        assert any((ROOT / folder).iterdir())


def test_container_and_pixi_name_what_the_project_has() -> None:
    docker = (ROOT / "Dockerfile").read_text()
    assert VERSION is not None
    assert 'pip install --no-cache-dir "numpy<2" "./src/idim_iv_ros[tables]"' in docker
    assert "ros2" in docker and "demo.launch.py" in docker
    assert (ROOT / "launch" / "demo.launch.py").is_file()
    tomllib = pytest.importorskip("tomllib")  # Python 3.11
    pixi = tomllib.loads((ROOT / "pixi.toml").read_text())
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    (name,) = pixi["pypi-dependencies"]
    assert name == project["name"]
    assert set(pixi["pypi-dependencies"][name]["extras"]) <= set(project["optional-dependencies"])


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
