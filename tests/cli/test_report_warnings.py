"""A page that cannot be drawn costs no result, and is one line of warning."""

import json
from pathlib import Path

import pytest

from idim_iv_ros.report import page


def _fails(*_: object, **__: object) -> str:
    raise ValueError("'list' argument must have no negative elements")


def test_a_page_that_cannot_be_drawn_at_all_leaves_the_numbers(
    run, config, bag, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page, "page_html", _fails)
    out = tmp_path / "out"
    done = run("identify", bag, "--config", config(), "--out", out, status=0)
    (warning,) = (line for line in done.error.splitlines() if "warning" in line)
    (numbers,) = out.iterdir()
    assert json.loads(numbers.read_text())["robot"]
    assert f"Numbers: {numbers}" in done.out.replace("\n", "")
    assert str(numbers) in warning
    assert "Traceback" not in done.error
