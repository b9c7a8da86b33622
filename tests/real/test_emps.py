"""EMPS (Janot, Gautier, Brunot: "Data set and reference models of EMPS", nonlinearbenchmark.org).

Expected values: the published IDIM-LS estimates, and an IDIM-IV reached independently
(shared/data/README.md).
"""

from pathlib import Path

import pytest

from idim_iv_ros import identify, load_configuration
from idim_iv_ros.identification.result import IdentificationResult
from tests.real.conftest import require_bodies
from tests.real.recordings import emps_bag

PUBLISHED = {"M1": 95.1089, "Fv1": 203.5034, "Fc1": 20.3935, "off1": -3.1648}


@pytest.fixture(scope="module")
def bag(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return emps_bag(data, tmp_path_factory.mktemp("emps") / "emps.mcap")


@pytest.fixture(scope="module")
def least_squares(bag: Path, config: Path) -> IdentificationResult:
    return identify([bag], load_configuration(config / "emps.yaml"), estimator="idim-ls")


@pytest.fixture(scope="module")
def instrumental(bag: Path, config: Path) -> IdentificationResult:
    return identify([bag], load_configuration(config / "emps.yaml"))


def test_least_squares_gives_the_published_values_to_four_decimals(least_squares) -> None:
    values = {parameter.name: parameter.value for parameter in least_squares.parameters}
    assert values == pytest.approx(PUBLISHED, abs=5e-5)


def test_least_squares_has_the_published_relative_error_and_condition_number(least_squares) -> None:
    assert least_squares.fit.relative_error_percent == pytest.approx(4.0834, abs=5e-5)
    assert least_squares.fit.condition_number == pytest.approx(25.99, abs=5e-3)


def test_iteration_starts_from_one_kilogram_and_converges_in_four(instrumental) -> None:
    assert {p.name: p.given_value for p in instrumental.parameters}["M1"] == 1.0
    assert instrumental.instruments.failures == ()
    assert instrumental.converged
    assert instrumental.iterations <= 4
    assert "configured control law" in instrumental.instruments.source


@pytest.mark.parametrize(("name", "percent"), [("M1", 0.3), ("Fv1", 0.3), ("Fc1", 1.0)])
def test_instrumental_variables_agree_with_least_squares(instrumental, name, percent) -> None:
    value = {parameter.name: parameter.value for parameter in instrumental.parameters}[name]
    assert value == pytest.approx(PUBLISHED[name], rel=percent / 100.0)


def test_the_axis_is_a_body_and_no_drive_gives_energy(instrumental) -> None:
    require_bodies(instrumental)


def test_instrumental_variables_agree_with_an_independent_run(instrumental) -> None:
    expected = {"M1": 95.174, "Fv1": 203.51, "Fc1": 20.394, "off1": -3.165}
    values = {parameter.name: parameter.value for parameter in instrumental.parameters}
    assert values == pytest.approx(expected, rel=5e-3)
