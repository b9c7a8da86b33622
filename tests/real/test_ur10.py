"""UR10 (UNISA inverse-dynamics-solver): a lone .db3 as it was found, effort in motor current."""

from pathlib import Path

import pytest

from idim_iv_ros import identify, load_configuration
from idim_iv_ros.identification.result import IdentificationResult


@pytest.fixture(scope="module")
def result(data: Path, config: Path) -> IdentificationResult:
    bag = data / "unisa_ur10" / "ur10_exciting_trajectory.db3"
    return identify([bag], load_configuration(config / "ur10.yaml"))


def test_bag_without_metadata_is_read_at_125_hertz(result: IdentificationResult) -> None:
    (bag,) = result.bags
    assert bag.rate == pytest.approx(125.0, rel=1e-3)
    assert bag.duration == pytest.approx(27.5, abs=0.1)


def test_parameters_are_in_units_of_motor_current(result: IdentificationResult) -> None:
    units = {parameter.name: parameter.unit for parameter in result.parameters}
    assert units["ZZ1"] == "A s²"
    assert units["Fc1"] == "A"


def test_relative_error_is_below_seven_percent(result: IdentificationResult) -> None:
    """About 5.5 % by least squares elsewhere (shared/data/README.md)."""
    assert result.fit.ls_relative_error_percent < 7.0
    assert result.fit.relative_error_percent < 7.0


def test_current_in_place_of_torque_is_no_mass(result: IdentificationResult) -> None:
    assert result.physical is None
    assert "A" in result.why_no_physical
