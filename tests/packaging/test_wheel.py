"""What is in the wheel, and what lies where in the package."""

import os
import re
import shutil
import subprocess
import sys
import tarfile
import xml.etree.ElementTree as ElementTree
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
NOT_SOURCES = shutil.ignore_patterns(".*", "build", "dist", "out", "*.egg-info", "__pycache__")
# Neither the sources nor the compiled kernels of the test suite may be found.
ALONE = {
    name: value
    for name, value in os.environ.items()
    if name not in ("PYTHONPATH", "NUMBA_CACHE_DIR", "VIRTUAL_ENV")
}

WHERE = "import idim_iv_ros; print(idim_iv_ros.__file__)"


def run(*command: str | Path, cwd: Path) -> str:
    """Standard output of a command that must succeed."""
    ended = subprocess.run(command, cwd=cwd, env=ALONE, capture_output=True, text=True)
    assert ended.returncode == 0, f"{ended.stdout[-2000:]}\n{ended.stderr[-2000:]}"
    return ended.stdout


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy: what an earlier build left beside the sources would enter the wheel."""
    folder = tmp_path_factory.mktemp("sources") / "idim_iv_ros"
    return Path(shutil.copytree(ROOT, folder, ignore=NOT_SOURCES))


@pytest.fixture(scope="module")
def built(sources: Path) -> Path:
    """The source distribution, and the wheel that was built from it."""
    folder = sources.parent / "dist"
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, ".", cwd=sources)
    return folder


def contents(wheel: Path) -> dict[str, bytes]:
    """Files of a wheel; RECORD lists them and their digests."""
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def test_wheel_holds_every_file_of_the_package(sources: Path, built: Path) -> None:
    (wheel,) = built.glob("*.whl")
    package = sources / "idim_iv_ros"
    files = {str(path.relative_to(sources)) for path in package.rglob("*") if path.is_file()}
    assert "idim_iv_ros/py.typed" in files
    assert files - contents(wheel).keys() == set()


def test_wheel_holds_nothing_beside_the_package(built: Path) -> None:
    (wheel,) = built.glob("*.whl")
    tops = {name.split("/")[0].split("-")[0] for name in contents(wheel)}
    assert tops == {"idim_iv_ros"}


def test_source_distribution_gives_the_wheel_of_the_sources(sources: Path, built: Path) -> None:
    (archive,) = built.glob("*.tar.gz")
    (wheel,) = built.glob("*.whl")
    with tarfile.open(archive) as unpacked:
        assert any(name.endswith("/LICENSE") for name in unpacked.getnames())
    folder = sources.parent / "direct"
    build = [sys.executable, "-m", "build", "--no-isolation", "--wheel", "--outdir", folder, "."]
    run(*build, cwd=sources)
    assert contents(folder / wheel.name) == contents(wheel)


@pytest.mark.slow
def test_wheel_brings_what_it_depends_on(built: Path, tmp_path: Path) -> None:
    """And identifies the arm of the demo, with nothing but what is installed."""
    environment, empty = tmp_path / "environment", tmp_path / "empty"
    empty.mkdir()
    run(sys.executable, "-m", "venv", environment, cwd=empty)
    (wheel,) = built.glob("*.whl")
    run(environment / "bin" / "python", "-m", "pip", "install", "-q", wheel, cwd=empty)
    place = run(environment / "bin" / "python", "-c", WHERE, cwd=empty)
    assert Path(place.strip()).is_relative_to(environment)
    command, share = environment / "bin" / "idim-iv", environment / "share" / "idim_iv_ros"
    call = [ROOT / "bags" / "arm6.mcap", "--config", share / "config" / "arm6.yaml"]
    assert run(command, "--version", cwd=empty).startswith("idim-iv ")
    assert "Usable." in run(command, "check", *call, cwd=empty)
    run(command, "identify", *call, "--out", "results", cwd=empty)
    assert (empty / "results" / "result.json").is_file()
    assert "<html" in (empty / "results" / "report.html").read_text(encoding="utf-8")
    shutil.rmtree(environment)  # up to a gigabyte


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
