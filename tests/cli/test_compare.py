"""Two results side by side: what differs is called, chance is not, and files of others refused."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from idim_iv_ros.identification.compare import compare_results
from idim_iv_ros.identification.result import IdentificationResult
from tests.report.sample_result import sample_result


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
