"""A motion that cannot be computed is refused by its number, before anything is allocated."""

import math

import pytest

from idim_iv_ros.configuration import load_configuration
from idim_iv_ros.errors import UsageError
from idim_iv_ros.excitation import load_model, motion_limits, random_motion, require_sampling
from idim_iv_ros.excitation.design import DesignSettings, require_possible
from tests.fuzz.case import CONFIG


@pytest.fixture(scope="module")
def configuration():
    return load_configuration(CONFIG / "arm2.yaml")


@pytest.mark.parametrize("rate", [0.0, -1.0, 1e-300, 1e300, math.inf, math.nan])
def test_rate_that_no_controller_has_is_refused(rate: float) -> None:
    with pytest.raises(UsageError, match="samples per second"):
        require_sampling(rate, 10.0, "the motion")


@pytest.mark.parametrize("duration", [0.0, -1.0, 1e9, 1e300, math.inf, math.nan])
def test_duration_that_cannot_be_computed_is_refused(duration: float) -> None:
    with pytest.raises(UsageError, match="the motion lasts"):
        require_sampling(1000.0, duration, "the motion")


@pytest.mark.parametrize("duration", [math.inf, 1e300, 1001.0, 0.5, math.nan])
def test_random_motion_of_any_duration_is_made_or_refused(configuration, duration: float) -> None:
    with pytest.raises(UsageError, match="duration"):
        random_motion(configuration, duration=duration, rate=100.0, seed=1)


@pytest.mark.parametrize(
    "settings", [{"period": 1e300}, {"repeats": 10**9}, {"harmonics": 10**9}, {"rate": 1e300}]
)
def test_design_that_cannot_be_computed_is_refused(configuration, settings) -> None:
    limits = motion_limits(load_model(configuration), configuration)
    with pytest.raises(UsageError, match=r"motion (lasts|has)|harmonics|rate"):
        require_possible(DesignSettings(**settings), limits, ("joint_1", "joint_2"))


@pytest.mark.parametrize("acceleration", [1e-300, 1e300, 0.0, math.nan])
def test_acceleration_that_no_joint_has_is_refused(configuration, acceleration: float) -> None:
    model = load_model(configuration)
    with pytest.raises(UsageError, match="rad/s²"):
        motion_limits(model, configuration, acceleration=[acceleration])
