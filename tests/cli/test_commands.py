"""The commands as a user runs them: tables, the demo, a page that cannot be drawn, two results."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from bags.demo import demo
from idim_iv_ros.identification.compare import compare_results
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.recording.read import read_recordings
from tests.report.sample_result import sample_result


def test_table_becomes_a_bag_is_checked_and_identified(run, config, columns, tmp_path) -> None:
    bag, out = tmp_path / "run.mcap", tmp_path / "results"
    assert "6000 samples" in run("import", bag, "--columns", columns, status=0).out
    assert "Usable" in run("check", bag, "--config", config(), status=0).out
    identified = run("identify", bag, "--config", config(), "--out", out, status=0)
    assert "Verdict" in identified.out
    assert len(identified.out.splitlines()) < 40
    assert (out / "report.html").is_file()
    document = json.loads((out / "result.json").read_text())
    assert document["format"] == "idim_iv_ros/identification/1"
    assert document["estimator"] == "idim-iv"
    assert document["converged"] is True
    expected = {
        *("format", "robot", "bags", "software", "estimator", "iterations", "converged"),
        *("parameters", "instruments", "exogeneity", "residuals", "fit", "refined", "timing"),
    }
    assert expected <= set(document)


def test_demo_compares_the_estimates_with_the_truth_and_writes_a_report(tmp_path, capsys) -> None:
    demo(tmp_path / "demo")
    printed = capsys.readouterr().out
    within, count = map(
        int, re.search(r"(\d+) of (\d+) base parameters lie within", printed).groups()
    )
    assert within >= 0.95 * count > 40
    assert printed.count(" σ ") > 20  # rows of the table: how far off the truth
    assert (tmp_path / "demo" / "report.html").is_file()


def _written(path: Path, result: IdentificationResult) -> Path:
    path.write_text(result.to_json())
    return path


def _drawn(seed: int, joints: int = 6, **changes: float) -> IdentificationResult:
    """A result whose estimates scatter by their deviations; `changes` in deviations."""
    random, result = np.random.default_rng(seed), sample_result(joints)
    parameters = [
        replace(
            parameter,
            value=parameter.value
            + parameter.std * (random.normal() + changes.get(parameter.name, 0.0)),
        )
        for parameter in result.parameters
    ]
    return replace(result, parameters=tuple(parameters))


def test_parameters_of_one_robot_differ_by_chance_only(tmp_path: Path) -> None:
    called = 0
    for seed in range(100):
        first = _written(tmp_path / "a.json", _drawn(2 * seed, 2))
        second = _written(tmp_path / "b.json", _drawn(2 * seed + 1, 2))
        called += any(pair.differs for pair in compare_results(first, second).pairs)
    assert called <= 11  # 5 % of 100, and two and a half standard deviations


def test_what_changed_is_called_and_comes_first(run, tmp_path: Path) -> None:
    name = sample_result(6).parameters[3].name
    first = _written(tmp_path / "a.json", _drawn(0))
    second = _written(tmp_path / "b.json", _drawn(1, **{name: 12.0}))
    done = run("compare", first, second, "--out", tmp_path / "out", "--json")
    document = json.loads(done.out)
    assert [pair["name"] for pair in document["pairs"] if pair["differs"]] == [name]
    assert document["pairs"][0]["name"] == name
    page = (tmp_path / "out" / "compare.html").read_text()
    assert all(f"<small>{pair['name']}</small></th>" in page for pair in document["pairs"])
    assert "XX1" not in document["sentence"]
    written = tmp_path / "out" / "robot.yaml"
    assert f"--config {written}" in re.sub("</?span>", "", page)
    assert yaml.safe_load(written.read_text()) == sample_result(6).configuration


@pytest.mark.parametrize("joints", [2, 5])
def test_results_of_another_robot_are_refused(run, tmp_path: Path, joints: int) -> None:
    first = _written(tmp_path / "a.json", sample_result(6))
    second = _written(tmp_path / "b.json", sample_result(joints))
    done = run("compare", first, second, "--out", tmp_path / "out", status=2)
    assert done.error.startswith(f"idim-iv: {second}: cannot be compared with {first}")
    assert not (tmp_path / "out").exists()


def test_init_proposes_a_map_that_imports(run, record, tmp_path: Path) -> None:
    header = "Time (ms),Pos J1,Pos J2,q_ref1,q_ref2,Vel J1,Vel J2,Tau J1,Tau J2,mode"
    table = np.column_stack(
        [1e3 * record.time, *[record.position] * 2, *[record.effort] * 2, 0.0 * record.time]
    )
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=header, comments="")
    map_path, bag = tmp_path / "map.yaml", tmp_path / "log.mcap"
    run("init", tmp_path / "log.csv", "--out", map_path, status=0)
    assert "# Not used: mode" in map_path.read_text()
    run("import", bag, "--columns", map_path, status=0)
    (recording,) = read_recordings([bag], joints=["joint_1", "joint_2"])
    np.testing.assert_allclose(recording.position.values, record.position, atol=1e-9)
    assert recording.unused_references == ("/joint_reference",)
