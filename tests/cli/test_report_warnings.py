"""A picture that cannot be drawn costs no result, whichever command draws it."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from idim_iv_ros.report import page, write
from tests.cli.test_diagnose import StandIn


def _fails(*_: object, **__: object) -> str:
    raise ValueError("'list' argument must have no negative elements")


def _broken(which: str, anchor: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make one section of a report fail."""
    sections = [
        replace(section, context=_fails) if section.anchor == anchor else section
        for section in getattr(page, which)
    ]
    monkeypatch.setattr(page, which, tuple(sections))


def test_identify_ends_well_with_one_warning_when_a_section_fails(
    run, config, bag, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _broken("IDENTIFICATION", "torque", monkeypatch)
    done = run("identify", bag, "--config", config(), "--out", tmp_path / "results", status=0)
    warned = [line for line in done.error.splitlines() if "warning" in line]
    assert len(warned) == 1
    assert "Torque" in warned[0]
    assert "Traceback" not in done.error
    assert json.loads((tmp_path / "results" / "result.json").read_text())["parameters"]
    text = (tmp_path / "results" / "report.html").read_text()
    assert "no negative elements). All numbers are in result.json." in text
    assert 'id="parameters"' in text
    assert f"Report: {tmp_path / 'results' / 'report.html'}" in done.out


def test_diagnose_ends_well_with_one_warning_when_a_section_fails(
    diagnose, tmp_path: Path, capfd, monkeypatch: pytest.MonkeyPatch
) -> None:
    _broken("DIAGNOSIS", "residuals", monkeypatch)
    diagnose(StandIn("both"))
    printed = capfd.readouterr()
    warned = [line for line in printed.err.splitlines() if "warning" in line]
    assert len(warned) == 1
    assert "Residual" in warned[0]
    assert json.loads((tmp_path / "why" / "gap.json").read_text())["verdict"] == "both"
    assert "All numbers are in gap.json." in (tmp_path / "why" / "report.html").read_text()


@pytest.mark.parametrize("command", ["identify", "diagnose"])
def test_a_page_that_cannot_be_drawn_at_all_leaves_the_numbers(
    run, diagnose, config, bag, tmp_path: Path, capfd, monkeypatch, command: str
) -> None:
    out = tmp_path / "out"
    monkeypatch.setattr(write, "report_html", _fails)
    monkeypatch.setattr(write, "gap_report_html", _fails)
    if command == "identify":
        done = run("identify", bag, "--config", config(), "--out", out, status=0)
        printed, error = done.out, done.error
    else:
        diagnose(StandIn("both"), out=out)
        printed, error = capfd.readouterr()
    (numbers,) = out.iterdir()
    assert json.loads(numbers.read_text())["robot"]
    assert f"Numbers: {numbers}" in printed.replace("\n", "")
    warned = [line for line in error.splitlines() if "warning" in line]
    assert len(warned) == 1
    assert str(numbers) in warned[0]
