"""An effect is one file: what diagnosis, report and simulators need of it is declared there."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import idim_iv_ros
from idim_iv_ros.effects.registry import EFFECTS

PACKAGE = Path(idim_iv_ros.__file__).parent
FOLDERS = ("diagnosis", "report", "simulators", "simulator_files")
# Where the same word is the name of something else.
OTHER_MEANING = {
    ("diagnosis/nominal.py", "drive_inertia"): "a key of the configuration, identification",
    ("simulators/robot.py", "drive_inertia"): "a key of the configuration, identification",
    ("simulator_files/changes.py", "torque_offset"): "a key of the configuration, simulator",
    ("report/sections/transmissions.py", "backlash"): "a number of `Transmission`",
}


def documentation(tree: ast.Module) -> set[int]:
    """Places of docstrings."""
    owners = (ast.Module, ast.ClassDef, ast.FunctionDef)
    nodes = [node for node in ast.walk(tree) if isinstance(node, owners)]
    return {id(node.body[0].value) for node in nodes if isinstance(node.body[0], ast.Expr)}


def names_in(file: Path) -> Iterator[str]:
    """Effects that a module names in its code: in a text, or as a module that it imports."""
    tree = ast.parse(file.read_text())
    passed = documentation(tree)
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith("idim_iv_ros.effects."):
            yield from {str(node.module).rpartition(".")[2]} & set(EFFECTS)
        if not isinstance(node, ast.Constant) or not isinstance(node.value, str):
            continue
        if id(node) not in passed:
            # A single word may be prose: it counts alone.
            words = {node.value, *re.findall(r"[a-z]+(?:_[a-z]+)+", node.value)}
            yield from words & set(EFFECTS)


@pytest.mark.parametrize("folder", FOLDERS)
def test_no_module_names_an_effect(folder: str) -> None:
    found = {
        (str(file.relative_to(PACKAGE)), name)
        for file in sorted((PACKAGE / folder).rglob("*.py"))
        for name in names_in(file)
    }
    assert found == {place for place in OTHER_MEANING if place[0].startswith(f"{folder}/")}
