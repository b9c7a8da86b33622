"""A picture that cannot be drawn costs no result, whichever command draws it."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from idim_iv_ros.report import page
from tests.cli.test_diagnose import StandIn

# Title of the section that is made to fail, and anchor of another.
SECTIONS = {"result.json": ("Torque", "parameters"), "gap.json": ("Residual", "causes")}


def _fails(*_: object, **__: object) -> str:
    raise ValueError("'list' argument must have no negative elements")


def _broken(which: str, anchor: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make one section of a report fail."""
    sections = [
        replace(section, context=_fails) if section.anchor == anchor else section
        for section in getattr(page, which)
    ]
    monkeypatch.setattr(page, which, tuple(sections))


@pytest.fixture(params=["identify", "diagnose"])
def answered(request, run, diagnose, config, bag, tmp_path: Path, capfd):
    """Run a command that ends well; return its folder, its stdout and its only warning."""

    def call() -> tuple[Path, str, str]:
        out = tmp_path / "out"
        if request.param == "identify":
            done = run("identify", bag, "--config", config(), "--out", out, status=0)
            printed, error = done.out, done.error
        else:
            diagnose(StandIn("both"), out=out)
            printed, error = capfd.readouterr()
        (warning,) = (line for line in error.splitlines() if "warning" in line)
        assert "Traceback" not in error
        return out, printed.replace("\n", ""), warning

    return call


def test_a_section_that_fails_costs_itself_alone(answered, monkeypatch: pytest.MonkeyPatch) -> None:
    _broken("IDENTIFICATION", "torque", monkeypatch)
    _broken("DIAGNOSIS", "residuals", monkeypatch)
    out, printed, warning = answered()
    (numbers,) = out.glob("*.json")
    title, other = SECTIONS[numbers.name]
    assert title in warning
    assert json.loads(numbers.read_text())["robot"]
    text = (out / "report.html").read_text()
    assert f"no negative elements). All numbers are in {numbers.name}." in text
    assert f'id="{other}"' in text
    assert f"Report: {out / 'report.html'}" in printed


def test_a_page_that_cannot_be_drawn_at_all_leaves_the_numbers(
    answered, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page, "page_html", _fails)
    out, printed, warning = answered()
    (numbers,) = out.iterdir()
    assert json.loads(numbers.read_text())["robot"]
    assert f"Numbers: {numbers}" in printed
    assert str(numbers) in warning
