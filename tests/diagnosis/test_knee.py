"""The knee of a saturation is that of the torque that acts, which the refit does not have."""

from dataclasses import replace

import numpy as np
import pytest

from idim_iv_ros.diagnosis.refit.baseline import Baseline, with_parameters
from idim_iv_ros.diagnosis.refit.smooth_motion import SmoothMotion
from idim_iv_ros.diagnosis.structural.attribution import attribute
from idim_iv_ros.diagnosis.structural.causes import effect_parameters, named_model
from idim_iv_ros.diagnosis.structural.knee import with_knees_refitted
from idim_iv_ros.effects.torque_saturation import TorqueSaturation
from tests.diagnosis.simulated_sessions import arm2_session
from tests.diagnosis.test_attribution import world

KNEE, SLOPE = 8.0, 0.5  # N m


@pytest.fixture(scope="module")
def data() -> Baseline:
    return arm2_session(12.0)


def command(motion: SmoothMotion) -> np.ndarray:
    """What is commanded beyond the torque that acts, N m."""
    torque = motion.torque[:, 0]
    beyond = np.maximum(np.abs(torque) - KNEE, 0.0)
    return np.asarray(np.sign(torque) * (1.0 / SLOPE - 1.0) * beyond)


def test_a_knee_is_found_though_the_refit_is_bent_by_it(data: Baseline) -> None:
    regression = world(data, 1, 0, command)
    bent = with_parameters(data, regression.fit().values)
    found = attribute(bent, regression, [TorqueSaturation()])
    first = named_model(found)
    settled = with_knees_refitted(bent, found, first)
    (before,), (after,) = (
        [each.candidate.shape.numbers[0] for each in model.found] for model in (first, settled)
    )
    assert abs(before - KNEE) > 0.4  # what it is about
    assert after == pytest.approx(KNEE, abs=0.1)
    slope = effect_parameters(settled, 0)["slope"]
    assert slope.value == pytest.approx(SLOPE, abs=0.02)


def test_models_without_a_knee_stay_as_they_are(data: Baseline) -> None:
    found = attribute(data, world(data, 2), [TorqueSaturation()])
    model = named_model(found)
    assert with_knees_refitted(data, replace(found), model) is model
