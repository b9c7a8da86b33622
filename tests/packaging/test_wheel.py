"""Wheel and source distribution: complete, equal, and running where nothing else is."""

import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Iterator
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


@pytest.fixture
def folders(tmp_path: Path) -> Iterator[tuple[Path, Path]]:
    """Where an environment is made, and an empty folder to work in."""
    (tmp_path / "empty").mkdir()
    yield tmp_path / "environment", tmp_path / "empty"
    shutil.rmtree(tmp_path / "environment")  # up to a gigabyte


def identify_the_arm(environment: Path, empty: Path) -> None:
    """The demo, with nothing but what is installed."""
    place = run(environment / "bin" / "python", "-c", WHERE, cwd=empty)
    assert Path(place.strip()).is_relative_to(environment)
    command, share = environment / "bin" / "idim-iv", environment / "share" / "idim_iv_ros"
    call = [ROOT / "bags" / "arm6.mcap", "--config", share / "config" / "arm6.yaml"]
    assert run(command, "--version", cwd=empty).startswith("idim-iv ")
    assert "Usable." in run(command, "check", *call, cwd=empty)
    run(command, "identify", *call, "--out", "results", cwd=empty)
    assert (empty / "results" / "result.json").is_file()
    assert "<html" in (empty / "results" / "report.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_wheel_identifies_the_arm_of_the_demo(built: Path, folders: tuple[Path, Path]) -> None:
    """The project from the wheel alone; what it depends on from the environment of the tests."""
    environment, empty = folders
    run(sys.executable, "-m", "venv", "--without-pip", environment, cwd=empty)
    (wheel,) = built.glob("*.whl")
    pip = [sys.executable, "-m", "pip", "--python", environment / "bin" / "python"]
    run(*pip, "install", "-q", "--no-deps", wheel, cwd=empty)
    (site,) = environment.glob("lib/python*/site-packages")
    borrowed = [path for path in sys.path if path.endswith("site-packages")]
    (site / "borrowed.pth").write_text("\n".join(borrowed), encoding="utf-8")
    identify_the_arm(environment, empty)


@pytest.mark.slow
def test_wheel_brings_what_it_depends_on(built: Path, folders: tuple[Path, Path]) -> None:
    environment, empty = folders
    run(sys.executable, "-m", "venv", environment, cwd=empty)
    (wheel,) = built.glob("*.whl")
    run(environment / "bin" / "python", "-m", "pip", "install", "-q", wheel, cwd=empty)
    identify_the_arm(environment, empty)
