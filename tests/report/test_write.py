"""Pages and numbers on disk, whatever the disk does, and those of a fleet."""

import json
import os
import warnings
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from benchmarks.fleet.synthetic import Drawn, fleet
from idim_iv_ros.errors import ReportWarning, UsageError
from idim_iv_ros.fleet.fleet_result import fleet_result
from idim_iv_ros.fleet.result import FleetResult
from idim_iv_ros.report import page
from idim_iv_ros.report.fleet import fleet_html, headline, steps
from idim_iv_ros.report.section import Files, Section
from idim_iv_ros.report.write import require_writable, write_report
from tests.report.sample_gap import sample_gap
from tests.report.sample_result import sample_result


def test_a_full_disk_leaves_what_was_there(tmp_path: Path, monkeypatch) -> None:
    """The old result whole, and no folder where there was none."""
    write_report(sample_gap(2, "none"), tmp_path)
    before = _files(tmp_path)

    full = Mock(side_effect=OSError(28, "No space left on device"))
    monkeypatch.setattr(os, "fsync", full)
    for out in (tmp_path, tmp_path / "new" / "deep"):
        with pytest.raises(UsageError, match=r"No space left on device; .*--out"):
            write_report(sample_gap(2, "both"), out)
        assert _files(tmp_path) == before


@pytest.mark.parametrize("command", ["identify", "diagnose"])
def test_a_disk_that_is_full_after_the_numbers_costs_the_page_alone(tmp_path, monkeypatch, command):
    """And no page of an earlier result is left beside the new numbers."""
    _, (numbers, written) = _written(command, tmp_path, 2)
    assert written is not None
    before = numbers.read_bytes()
    full = Mock(side_effect=[None, *[OSError(28, "No space left on device")] * 9])
    monkeypatch.setattr(os, "fsync", full)
    lines, (numbers, written) = _written(command, tmp_path, 3)
    assert written is None
    assert numbers.read_bytes() != before
    assert [path.name for path in tmp_path.iterdir()] == [numbers.name]
    (line,) = lines
    assert "No space left on device" in line
    assert str(numbers) in line


def _anchors(text: str, sections: tuple[Section, ...]) -> set[str]:
    """Sections that are on a page."""
    return {part.anchor for part in sections if f'<section id="{part.anchor}"' in text}


@pytest.mark.parametrize("command", ["identify", "diagnose"])
def test_no_section_of_a_report_costs_a_result_nor_the_other_sections(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    which = {"identify": "IDENTIFICATION", "diagnose": "DIAGNOSIS"}[command]
    sections = getattr(page, which)
    _, (_, whole) = _written(command, tmp_path / "whole", 2)
    there = _anchors(whole.read_text(encoding="utf-8"), sections)
    # Transmissions, a contrast and notes are not of every recording.
    assert len(there) > len(sections) / 2
    for number, section in enumerate(sections):
        broken = replace(section, template="no negative\nelements")
        monkeypatch.setattr(page, which, (*sections[:number], broken, *sections[number + 1 :]))
        lines, (numbers, written) = _written(command, tmp_path / section.anchor, 2)
        assert json.loads(numbers.read_text(encoding="utf-8"))["robot"]
        text = written.read_text(encoding="utf-8")
        assert text.count("negative elements") == 1
        assert f"All numbers are in {numbers.name}." in text
        assert _anchors(text, sections) == there | {section.anchor}
        (line,) = lines
        assert section.title in line
        monkeypatch.undo()


def _written(command: str, out: Path, joints: int):
    """Warnings in words, and what was written."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ReportWarning)
        if command == "identify":
            written = write_report(sample_result(joints), out)
        else:
            written = write_report(sample_gap(joints, "both"), out)
    lines = [str(warning.message) for warning in caught]
    assert all("\n" not in line for line in lines)
    return lines, written


def test_a_file_in_the_place_of_the_folder_is_refused_in_one_line(tmp_path: Path) -> None:
    place = tmp_path / "taken"
    place.write_text("mine")
    for out in (place, place / "below"):
        with pytest.raises(UsageError, match="a file is in its place") as refusal:
            write_report(sample_result(1), out)
        assert str(out) in str(refusal.value)
    assert place.read_text() == "mine"


def _files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_a_diagnosis_does_not_replace_the_report_of_an_identification(tmp_path: Path) -> None:
    write_report(sample_result(1), tmp_path)
    before = _files(tmp_path)
    with pytest.raises(UsageError, match=r"holds result\.json"):
        write_report(sample_gap(2, "none"), tmp_path)
    assert _files(tmp_path) == before


def test_a_folder_in_the_place_of_a_file_is_refused_early(tmp_path: Path) -> None:
    (tmp_path / "result.json").mkdir()
    with pytest.raises(UsageError, match="is a folder"), require_writable(tmp_path):
        pytest.fail("the work was started")


@pytest.mark.parametrize("existing", [False, True])
def test_failed_work_leaves_what_was_there_before(tmp_path: Path, existing: bool) -> None:
    out = tmp_path / "a" / "b"
    if existing:
        out.mkdir(parents=True)
        (out / "notes.txt").write_text("mine")
    before = list(tmp_path.rglob("*"))
    with pytest.raises(KeyboardInterrupt), require_writable(out):
        raise KeyboardInterrupt
    assert list(tmp_path.rglob("*")) == before


STEP = [0.0] * 5 + [5.0] * 5


@pytest.fixture(scope="module")
def result() -> FleetResult:
    """Six robots, one of which differs and one changed; a bag is corrupt, a name is hostile."""
    drawn = Drawn(robots=6, bags=10, planted={(0, "MX2"): 20.0}, drifting={(1, "Fc1"): STEP})
    bags, _ = fleet(drawn, np.random.default_rng(3))
    bags = [replace(bag, robot=bag.robot.replace("006", "<b>6")) for bag in bags]
    bags[29] = replace(bags[29], status="corrupt", reason="the file is cut off")
    return fleet_result(bags)


def test_the_page_names_robots_that_differ_or_changed_and_bags_that_were_not_used(result) -> None:
    page = fleet_html(result, {"arm2-001": "robots/arm2-001/report.html"})
    assert headline(result).startswith("1 robot differs from the type (arm2-001); ")
    assert "changed over time (arm2-002" in headline(result)
    assert '<a href="robots/arm2-001/report.html">arm2-001</a>' in page
    assert "arm2-003/10.mcap" in page and "The file is cut off." in page
    assert page.count("data-figure=") == 1 + sum(len(robot.changes) for robot in result.robots)
    assert "<b>6" not in page and "&lt;b&gt;6" in page


def test_the_next_command_compares_a_robot_that_differs_with_an_ordinary_one(result) -> None:
    files = Files("arm2.yaml", "out", ("bags",))
    (first,) = steps(result, {}, files)
    assert first.code == "idim-iv fleet diagnose bags --config arm2.yaml --out out"
    (first,) = steps(result, {"arm2-001": "robots/arm2-001/report.html"}, files)
    before, after = first.code.removeprefix("idim-iv diagnose ").split(" --against ")
    assert "arm2-001" not in before and after.count("arm2-001") == after.count(".mcap") > 0
    changed = replace(result, robots=tuple(r for r in result.robots if r.attention == "changed"))
    (first,) = steps(changed, {"arm2-002": "report.html"}, files)
    bags = " ".join(f"arm2-002/0{k}.mcap" for k in (3, 4, 5))
    assert first.code.startswith(f"idim-iv diagnose {bags} --against ")


def test_a_fleet_in_which_nothing_stands_out_says_so() -> None:
    bags, _ = fleet(Drawn(robots=5, bags=5), np.random.default_rng(1))
    assert headline(fleet_result(bags)).startswith("No robot differs from its type")
    few = fleet_result(bags[:5])
    assert headline(few).startswith("There are too few robots")
    assert "nothing says what is ordinary" in fleet_html(few)


def test_numbers_and_page_are_written_and_replaced_but_not_files_of_others(result, tmp_path):
    numbers, page = write_report(result, tmp_path)
    assert numbers.name == "fleet.json" and page is not None and page.name == "fleet.html"
    assert FleetResult.read(numbers).to_json() == result.to_json()
    write_report(result, tmp_path)
    numbers.write_text("mine", encoding="utf-8")
    with pytest.raises(UsageError):
        write_report(result, tmp_path)
