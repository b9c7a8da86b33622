"""The package as ros2 run and colcon see it, without either of their command lines."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix, get_package_share_directory

from tests.ros.conftest import ARM2
from tests.ros.processes import HANG, ROOT, SETTINGS, Process

NODE = "started_from_the_index"


@pytest.fixture(scope="module")
def prefix(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package as pip installs it (not editable), from a copy: it builds in the sources."""
    folder = tmp_path_factory.mktemp("prefix")
    others = shutil.ignore_patterns(
        ".*", "build", "*.egg-info", "tests", "benchmarks", "__pycache__"
    )
    source = shutil.copytree(ROOT, folder / "source", ignore=others)
    pip = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--ignore-installed"]
    call = [*pip, "--no-build-isolation", "--prefix", folder, source]
    subprocess.run(call, check=True, capture_output=True)
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
    share = Path(get_package_share_directory("idim_iv_ros"))
    for file in ("launch/robots.launch.py", "params/nodes.yaml"):
        assert (share / file).is_file()
    files = executables(prefix, "idim_iv_ros")
    assert set(files) == set(SETTINGS)
    # They differ by the name of the node alone: one that starts stands for all.
    texts = {
        path.read_text().replace(name, "").replace(name.removeprefix("robot_"), "")
        for name, path in files.items()
    }
    assert len(texts) == 1
    (site,) = prefix.glob("lib/python*/site-packages")
    monkeypatch.setenv("PYTHONPATH", str(site))
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    recorder = str(files["recorder"])
    about = subprocess.run([recorder, "--help"], capture_output=True, text=True, cwd=tmp_path)
    assert (about.returncode, about.stderr) == (0, "")
    assert about.stdout.startswith("recorder: ")
    node = f"{NODE}_recorder"
    process = Process([recorder, "--ros-args", "-r", f"__node:={node}"], tmp_path, node)
    stack.callback(process.end)
    observer.until(lambda: node in observer.node.get_node_names(), node)


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scratch folder in whose environment `builder` colcon can build the messages."""
    tomllib = pytest.importorskip("tomllib")  # Python 3.11
    folder = tmp_path_factory.mktemp("workspace")
    subprocess.run([sys.executable, "-m", "venv", folder / "builder"], check=True)
    document = tomllib.loads((ROOT / "idim_iv_interfaces" / "pyproject.toml").read_text())
    needed = [*document["build-system"]["requires"], "colcon-common-extensions", "colcon-ros"]
    pip = [str(folder / "builder" / "bin" / "python"), "-m", "pip", "install", "-q", *needed]
    subprocess.run(pip, check=True, capture_output=True)
    return folder


@pytest.mark.load
@pytest.mark.parametrize("option", ["--merge-install", "--symlink-install"])
def test_colcon_builds_both_packages_and_the_recorder_starts(
    workspace: Path, tmp_path: Path, option: str, observer
) -> None:
    builder = workspace / "builder"
    paths = f"{builder / 'bin'}:{os.environ['PATH']}"
    built = subprocess.run(
        ["colcon", "build", option, "--base-paths", ROOT],
        cwd=tmp_path,
        env={**os.environ, "PATH": paths, "CMAKE_PREFIX_PATH": str(builder)},
        capture_output=True,
        text=True,
    )
    assert built.returncode == 0, built.stderr
    assert "2 packages finished" in built.stdout
    setup = tmp_path / "install" / "setup.bash"
    find = "from ament_index_python import get_package_prefix as p; print(p('idim_iv_ros'))"
    python = Path(sys.executable).parent
    node = f"{NODE}_{option.strip('-').replace('-', '_')}"
    command = (
        f'. {setup}; PATH={python}:$PATH; prefix=$(python -c "{find}"); '
        f"exec $prefix/lib/idim_iv_ros/recorder --ros-args -r __node:={node}"
    )
    process = Process(["bash", "-c", command], tmp_path, node)
    observer.follow(process)
    assert process.finish() == 0


def test_security_that_cannot_begin_is_one_line(tmp_path: Path) -> None:
    node = "recorder"
    (tmp_path / "enclaves").mkdir()
    environment = {
        **os.environ,
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        "ROS_SECURITY_ENABLE": "true",
        "ROS_SECURITY_STRATEGY": "Enforce",
        "ROS_SECURITY_KEYSTORE": str(tmp_path / "missing"),
    }
    ended = subprocess.run(
        [ROOT / "scripts" / node, "--ros-args", "-p", f"configuration:={ARM2}"],
        env=environment,
        capture_output=True,
        text=True,
        timeout=HANG,
        cwd=tmp_path,
    )
    assert ended.returncode == 2
    (line,) = [line for line in ended.stderr.splitlines() if not line.startswith("[INFO]")]
    assert line.startswith(f"{node}: DDS security is switched on (ROS_SECURITY_ENABLE)")
    assert "the wheels of PyPI have none" in line
