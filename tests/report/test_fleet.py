"""The page of a fleet."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.fleet.synthetic import Drawn, fleet
from idim_iv_ros.errors import UsageError
from idim_iv_ros.fleet.fleet_result import fleet_result
from idim_iv_ros.fleet.result import FleetResult
from idim_iv_ros.report import write_report
from idim_iv_ros.report.fleet import fleet_html, headline, steps
from idim_iv_ros.report.section import Files

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
