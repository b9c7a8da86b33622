"""What the pages name is there."""

import re

import pytest

import idim_iv_ros
from tests.documentation.code_blocks import ROOT

THEORY = (ROOT / "docs" / "theory.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| (.+?) \| (.+?) \| (.+?) \|$", THEORY, flags=re.MULTILINE)[1:]
FUNCTIONS = sorted({name for row in ROWS for name in re.findall(r"`([\w.]+)`", row[1])})
TESTS = sorted(set(re.findall(r"`(tests/[\w./]*)`", THEORY)))


def test_api_page_lists_every_public_name() -> None:
    listed = re.findall(r"^::: idim_iv_ros\.(\w+)$", (ROOT / "docs" / "api.md").read_text(), re.M)
    assert sorted(listed) == sorted(idim_iv_ros.__all__)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_function_of_the_theory_is_in_its_folder(name: str) -> None:
    """The first part is a folder; the last is what it defines, or a file or folder in it."""
    folder, *_, last = name.split(".")
    base = ROOT / folder if folder == "benchmarks" else ROOT / "idim_iv_ros" / folder
    files = [base, *base.rglob("*")]
    defined = re.compile(rf"^\s*(def|class) {last}\b", flags=re.MULTILINE)
    assert base.is_dir()
    assert any(
        path.stem == last or (path.suffix == ".py" and defined.search(path.read_text("utf-8")))
        for path in files
    )


@pytest.mark.parametrize("path", TESTS)
def test_test_of_the_theory_is_there(path: str) -> None:
    assert (ROOT / path).exists()


def test_the_map_of_the_package_is_that_of_its_folders() -> None:
    pytest.importorskip("tomllib")  # Python 3.11
    from docs.package_map import PAGE, with_map

    page = PAGE.read_text(encoding="utf-8")
    assert with_map(page) == page
