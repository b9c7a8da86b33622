"""A motion that cannot be computed is refused by its number, before anything is allocated."""

import math

import numpy as np
import pytest

from idim_iv_ros.configuration import load_configuration
from idim_iv_ros.errors import UsageError
from idim_iv_ros.excitation import (
    load_model,
    motion_limits,
    require_sampling,
    servo_motion,
)
from idim_iv_ros.excitation.design import DesignSettings, require_possible
from tests.fuzz.case import CONFIG


@pytest.fixture(scope="module")
def configuration():
    return load_configuration(CONFIG / "arm2.yaml")


@pytest.mark.parametrize(
    ("rate", "duration", "words"),
    [
        *((rate, 10.0, "samples per second") for rate in (0.0, -1.0, 1e-300, 1e300, math.nan)),
        *((1000.0, seconds, "motion lasts") for seconds in (0.0, -1.0, 1e9, math.inf, math.nan)),
    ],
)
def test_sampling_that_cannot_be_computed_is_refused(rate, duration, words) -> None:
    with pytest.raises(UsageError, match=words):
        require_sampling(rate, duration, "the motion")


@pytest.mark.parametrize(
    "settings", [{"period": 1e300}, {"repeats": 10**9}, {"harmonics": 10**9}, {"rate": 1e300}]
)
def test_design_that_cannot_be_computed_is_refused(configuration, settings) -> None:
    limits = motion_limits(load_model(configuration), configuration)
    with pytest.raises(UsageError, match=r"motion (lasts|has)|harmonics|repeats"):
        require_possible(DesignSettings(**settings), limits, ("joint_1", "joint_2"))


def test_motion_for_servos_uses_its_limits_and_keeps_them() -> None:
    configuration = load_configuration(CONFIG / "arm6.yaml")
    limits = motion_limits(load_model(configuration), configuration)
    motion, highest, document = servo_motion(configuration, limits, rate=100.0, seed=1)
    assert motion.duration == 20.0 and highest == 2.0 and document["purpose"] == "servo"
    assert (motion.position >= limits.lower).all() and (motion.position <= limits.upper).all()
    speed, acceleration = np.abs(motion.velocity), np.abs(motion.acceleration)
    assert (speed <= limits.velocity).all() and (acceleration <= limits.acceleration).all()
    np.testing.assert_allclose(motion.velocity[[0, -1]], 0.0, atol=1e-9)
    reversals = (np.diff(np.sign(motion.velocity), axis=0) != 0).sum(axis=0)
    assert (reversals >= 10).all()
