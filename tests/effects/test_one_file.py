"""An effect is one file: what others need of it they read from the registry."""

import ast
import re
import sys
from importlib import import_module
from pathlib import Path

import pytest

import idim_iv_ros
from idim_iv_ros import effects
from idim_iv_ros.effects import registry
from idim_iv_ros.effects.registry import BY_NAME

PACKAGE = Path(idim_iv_ros.__file__).parent
OWNERS = (ast.Module, ast.ClassDef, ast.FunctionDef)
COMPOUND = re.compile("[a-z]+(?:_[a-z]+)+")
FOLDERS = ("simulation", "diagnosis", "report", "simulators", "simulator_files", "fleet")
KEY = "a key of the configuration, not an effect"
ALLOWED = {
    ("report/changes.py", "torque_offset"): KEY,
    ("report/sections/drives.py", "backlash"): "a column of measured numbers",
    ("simulator_files/changes.py", "torque_offset"): KEY,
    ("simulators/recording.py", "drive_inertia"): KEY,
}


def named(path: Path) -> set[str]:
    """Effects that a file has as a string or in one, imports from, or imports the name of.

    A single word within a text may be prose, and docstrings are.
    """
    modules = {type(cause).__module__: name for name, cause in BY_NAME.items()}
    tree = ast.parse(path.read_text(encoding="utf-8"))
    bodies = [node.body[0] for node in ast.walk(tree) if isinstance(node, OWNERS)]
    documentation = [body.value for body in bodies if isinstance(body, ast.Expr)]
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            if node not in documentation:
                names |= {node.value, *COMPOUND.findall(node.value)} & set(BY_NAME)
        elif isinstance(node, ast.ImportFrom):
            inner = [f"{node.module}.{alias.name}" for alias in node.names]
            names |= {modules[name] for name in (node.module, *inner) if name in modules}
            if str(node.module).startswith("idim_iv_ros"):
                source = vars(import_module(str(node.module)))
                values = [source.get(alias.name) for alias in node.names]
                names |= {value for value in values if isinstance(value, str) and value in BY_NAME}
    return names


def test_no_other_module_names_an_effect() -> None:
    uses = {
        (path.relative_to(PACKAGE).as_posix(), name)
        for folder in FOLDERS
        for path in (PACKAGE / folder).rglob("*.py")
        for name in named(path)
    }
    assert uses == set(ALLOWED)


def test_an_effect_is_added_by_its_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (Path(effects.__path__[0]) / "spring.py").read_text()
    text = text.replace('name = "spring"', 'name = "rope"').replace("order = 130", "order = 5")
    (tmp_path / "rope.py").write_text(text)
    monkeypatch.setattr(effects, "__path__", [*effects.__path__, str(tmp_path)])
    names = [cause.name for cause in registry._one_of_each(registry._modules())]
    assert names.index("rope") == names.index("stribeck") - 1
    del sys.modules["idim_iv_ros.effects.rope"]
