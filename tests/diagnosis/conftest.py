"""The simulated arm that many tests start from, and its session."""

import pytest

from bags.simulated_arms import SimulatedArm, arm2
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from tests.diagnosis.motions import arm2_session


@pytest.fixture(scope="module")
def arm() -> SimulatedArm:
    return arm2(seconds=10.0)


@pytest.fixture(scope="module")
def data() -> Baseline:
    """One recording of that arm, refitted; what it really is differs from its configuration."""
    return arm2_session(10.0, 1000.0)
