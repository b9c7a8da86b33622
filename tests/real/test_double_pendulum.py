"""DFKI double pendulum (underactuated lab, design A): gains recovered, published model found."""

from pathlib import Path

import pytest

from idim_iv_ros import identify, load_configuration
from idim_iv_ros.identification.result import IdentificationResult
from tests.real.conftest import require_bodies
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
