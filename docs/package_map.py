"""The map of the package in CONTRIBUTING.md, from the first lines of its folders.

python docs/package_map.py    # writes it
"""

import ast
import re
from pathlib import Path

import tomllib

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "CONTRIBUTING.md"
_BLOCK = re.compile(r"(?<=```text\nidim_iv_ros/\n).*?(?=^\S)", re.S | re.M)


def package_map() -> str:
    """One line a folder, in the order in which data flows."""
    document = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    layers = document["tool"]["importlinter"]["contracts"][0]["layers"]
    names = [name.strip() for layer in reversed(layers) for name in layer.split("|")]
    folders = [ROOT / "idim_iv_ros" / name for name in names]
    lines = ["  configuration …       one YAML a robot; errors, files, progress, types"]
    for folder in folders:
        if (folder / "__init__.py").is_file():
            first = ast.get_docstring(ast.parse((folder / "__init__.py").read_text())) or ""
            lines.append(f"  {folder.name + '/':21} {first.splitlines()[0].rstrip('.:')}")
    return "\n".join(lines) + "\n"


def with_map(page: str) -> str:
    """Return the page with the present map."""
    return _BLOCK.sub(lambda _: package_map(), page, count=1)


if __name__ == "__main__":
    PAGE.write_text(with_map(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
