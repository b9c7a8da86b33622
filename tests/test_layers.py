"""Data moves down the list of folders, and none imports one below it (CONTRIBUTING: Layout)."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "idim_iv_ros"
ORDER = (
    *("recording", "signals", "model", "effects", "simulation", "estimation", "statistics"),
    *(
        "physical",
        "identification",
        "servo",
        "prediction",
        "diagnosis",
        "excitation",
        "first_configuration",
    ),
    *("simulators", "simulator_files", "fleet", "report", "nodes", "cli"),
)


def imported(path: Path) -> set[str]:
    """Folders and modules of the package that a file imports, also inside functions."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    names = [n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) and n.module]
    names += [a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names]
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            if node.module == "idim_iv_ros":
                names += [f"idim_iv_ros.{each.name}" for each in node.names]
    return {name.split(".")[1] for name in names if name.startswith("idim_iv_ros.")}


def test_every_folder_has_its_place() -> None:
    folders = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}
    assert folders == set(ORDER)


@pytest.mark.parametrize("folder", ORDER)
def test_a_folder_imports_none_below_it(folder: str) -> None:
    below = set(ORDER[ORDER.index(folder) + 1 :])
    for path in (PACKAGE / folder).rglob("*.py"):
        assert not imported(path) & below, path


def test_what_lies_beside_the_folders_imports_none_of_them_but_the_public_names() -> None:
    for path in PACKAGE.glob("*.py"):
        if path.name not in ("__init__.py", "schemas.py"):
            assert not imported(path) & set(ORDER), path
