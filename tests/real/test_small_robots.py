"""Real recordings of a double pendulum, a UR10 and a servo drive."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.servos import sts3215, with_load
from idim_iv_ros import identify, load_configuration
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.servo.fit import fit_factor, fit_joint
from tests.real.conftest import DATA, require_bodies
from tests.real.recordings import double_pendulum_bag

# identified_model_2.0.yml: m1 = 0.5594, r1 = 0.3, m2 = 0.6043, l1 = 0.3, r2 = 0.1838
PUBLISHED = {"MX1": 0.5594 * 0.3 + 0.6043 * 0.3, "MX2": 0.6043 * 0.1838}


@pytest.fixture(scope="module")
def result(data: Path, config: Path, tmp_path_factory) -> IdentificationResult:
    out = double_pendulum_bag(data, tmp_path_factory.mktemp("dfki") / "double_pendulum.mcap")
    return identify([out], load_configuration(config / "double_pendulum.yaml"))


def test_control_law_is_recovered(result: IdentificationResult) -> None:
    """Kp about 20 N m/rad and Kd about 0.5 N m s/rad on both joints (shared/data/README.md)."""
    assert "fitted control law" in result.instruments.source
    gains = {(gain.joint, gain.term): gain for gain in result.fitted_gains}
    for joint in ("shoulder", "elbow"):
        assert gains[joint, "kp"].r_squared > 0.95
        assert gains[joint, "kp"].value == pytest.approx(20.0, rel=0.1)
        assert gains[joint, "kd"].value == pytest.approx(0.5, rel=0.25)


def test_every_link_is_a_body_and_no_drive_gives_energy(result: IdentificationResult) -> None:
    require_bodies(result)


@pytest.mark.parametrize("name", ["MX1", "MX2"])
def test_published_first_moments_are_found_within_ten_percent(result, name) -> None:
    value = {parameter.name: parameter.value for parameter in result.parameters}[name]
    assert result.converged
    assert value == pytest.approx(PUBLISHED[name], rel=0.10)


@pytest.fixture(scope="module")
def found(data: Path, config: Path) -> IdentificationResult:
    bag = data / "unisa_ur10" / "ur10_exciting_trajectory.db3"
    return identify([bag], load_configuration(config / "ur10.yaml"))


def test_bag_without_metadata_is_read_at_125_hertz(found: IdentificationResult) -> None:
    (bag,) = found.bags
    assert bag.rate == pytest.approx(125.0, rel=1e-3)
    assert bag.duration == pytest.approx(27.5, abs=0.1)


def test_parameters_are_in_units_of_motor_current(found: IdentificationResult) -> None:
    units = {parameter.name: parameter.unit for parameter in found.parameters}
    assert units["ZZ1"] == "A s²"
    assert units["Fc1"] == "A"


def test_relative_error_is_below_seven_percent(found: IdentificationResult) -> None:
    """About 5.5 % by least squares elsewhere (shared/data/README.md)."""
    assert found.fit.ls_relative_error_percent < 7.0
    assert found.fit.relative_error_percent < 7.0


def test_current_in_place_of_torque_is_no_mass(found: IdentificationResult) -> None:
    assert found.physical is None
    assert "A" in found.why_no_physical


def test_masses_of_runs_that_were_not_used():
    runs = {
        name: run
        for name, run in sts3215(DATA / "feetech_sts3215").items()
        if name.startswith("sin_sin") and "_kp12_" in name
    }
    answer = fit_joint([run for name, run in runs.items() if "0.535" in name])
    factors = np.array(
        [fit_factor(with_load(run), answer)[0] for n, run in runs.items() if "0.969" in n]
    )
    assert len(factors) == 4
    np.testing.assert_allclose(factors, 1.0, atol=0.05)
