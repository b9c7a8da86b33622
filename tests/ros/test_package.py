"""The package as ros2 run and colcon see it, without either of their command lines."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix, get_package_share_directory

from tests.ros.processes import ROOT, Process

NODE = "started_from_the_index"


@pytest.fixture(scope="module")
def prefix(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package as pip installs it (not editable)."""
    folder = tmp_path_factory.mktemp("prefix")
    pip = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--ignore-installed"]
    subprocess.run([*pip, "--prefix", str(folder), str(ROOT)], check=True, capture_output=True)
    return folder


def executables(prefix: Path, package: str) -> dict[str, Path]:
    """What ros2 run would offer."""
    folder = prefix / "lib" / package
    return {path.name: path for path in folder.iterdir() if os.access(path, os.X_OK)}


def test_index_lists_package_and_executables_start(
    prefix: Path, monkeypatch, observer, stack, tmp_path: Path
) -> None:
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(prefix))
    assert Path(get_package_prefix("idim_iv_ros")) == prefix
    assert (Path(get_package_share_directory("idim_iv_ros")) / "package.xml").is_file()
    found = executables(prefix, "idim_iv_ros")
    assert set(found) == {"recorder", "identifier", "robot_simulator"}
    (site,) = prefix.glob("lib/python*/site-packages")
    monkeypatch.setenv("PYTHONPATH", str(site))
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    configuration = ROOT / "config" / "arm2.yaml"
    for name, path in found.items():
        node = f"{NODE}_{name}"
        arguments = ["-r", f"__node:={node}", "-p", f"configuration:={configuration}"]
        process = Process([str(path), "--ros-args", *arguments], tmp_path, node)
        stack.callback(process.kill)
        observer.until(lambda: node in observer.node.get_node_names(), node)  # noqa: B023


@pytest.mark.load
def test_colcon_builds_both_packages_and_the_recorder_starts(tmp_path: Path, observer) -> None:
    tomllib = pytest.importorskip("tomllib")  # Python 3.11
    builder = tmp_path / "builder"
    subprocess.run([sys.executable, "-m", "venv", builder], check=True)
    document = tomllib.loads((ROOT / "idim_iv_interfaces" / "pyproject.toml").read_text())
    needed = [*document["build-system"]["requires"], "colcon-common-extensions", "colcon-ros"]
    pip = [str(builder / "bin" / "python"), "-m", "pip", "install", "-q", *needed]
    subprocess.run(pip, check=True, capture_output=True)
    workspace = tmp_path / "ws"
    workspace.mkdir()
    paths = f"{builder / 'bin'}:{os.environ['PATH']}"
    built = subprocess.run(
        ["colcon", "build", "--base-paths", ROOT, ROOT / "idim_iv_interfaces"],
        cwd=workspace,
        env={**os.environ, "PATH": paths, "CMAKE_PREFIX_PATH": str(builder)},
        capture_output=True,
        text=True,
    )
    assert built.returncode == 0, built.stderr
    assert "2 packages finished" in built.stdout
    setup = workspace / "install" / "setup.bash"
    path = workspace / "install" / "idim_iv_ros" / "lib" / "idim_iv_ros" / "recorder"
    python = Path(sys.executable).parent
    command = f". {setup}; PATH={python}:$PATH exec {path} --ros-args -r __node:={NODE}_colcon"
    process = Process(["bash", "-c", command], tmp_path, f"{NODE}_colcon")
    observer.follow(process)
    assert process.finish() == 0
