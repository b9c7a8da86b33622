"""Physical parameters of real recordings: every link a body, and no worse where not fitted."""

from pathlib import Path

import pytest

from idim_iv_ros import identify, load_configuration
from idim_iv_ros.identification.result import IdentificationResult
from tests.real.recordings import double_pendulum_bag, emps_bag, tx40_bag, tx40_configuration


@pytest.fixture(scope="module", params=["emps", "tx40", "double_pendulum"])
def result(
    request: pytest.FixtureRequest,
    data: Path,
    config: Path,
    tmp_path_factory: pytest.TempPathFactory,
) -> IdentificationResult:
    folder, name = tmp_path_factory.mktemp("physical"), request.param
    make = {"emps": emps_bag, "tx40": tx40_bag, "double_pendulum": double_pendulum_bag}[name]
    bag = make(data, folder / f"{name}.mcap")
    if name == "tx40":
        return identify([bag], tx40_configuration(data, folder))
    return identify([bag], load_configuration(config / f"{name}.yaml"))


def test_the_held_out_error_is_at_most_two_percent_worse(result: IdentificationResult) -> None:
    assert result.physical is not None
    error = result.physical.torque_error
    assert error is not None and error.held_out_before is not None
    assert error.held_out_after is not None
    assert error.held_out_after <= 1.02 * error.held_out_before


def test_every_link_is_a_body_and_no_drive_gives_energy(result: IdentificationResult) -> None:
    assert result.physical is not None
    assert all(link.eigenvalues[0] > 0.0 for link in result.physical.links)
    for name, value in result.physical.values.items():
        assert value >= 0.0 or not name.startswith(("Ia", "Fv", "Fc"))
