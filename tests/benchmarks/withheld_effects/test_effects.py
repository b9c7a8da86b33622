from functools import lru_cache

import numpy as np
import pytest

from benchmarks.withheld_effects.calibration import calibrate, ratio, session, variance
from benchmarks.withheld_effects.effects import EFFECTS, PARAMETRIC
from tests.benchmarks.withheld_effects.sessions import courses, world

pytestmark = pytest.mark.bench

# These move several links, so that the largest change may be at another joint.
SPREAD = {"payload", "link_inertia", "gravity_direction", "joint_coupling", "elasticity"} | {
    "backlash",
    "contact_pulses",
}


@lru_cache
def floor(altered, measure):
    true = world(altered=altered)
    return variance(true, session(true, courses("arm2", 8.0, 1)), measure)


def shown(name, strengths, joint=1):
    true = world(altered=name not in PARAMETRIC)
    effect = EFFECTS[name](np.random.default_rng(2), true.given, joint)
    without = floor(name not in PARAMETRIC, effect.measure)
    ratios = []
    for strength in strengths:
        records = session(effect.apply(true, strength * effect.usual), courses("arm2", 8.0, 1))
        ratios.append(ratio(variance(true, records, effect.measure), without))
    return effect, ratios


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_an_effect_shows_at_the_joint_that_it_claims_and_grows(name):
    # Three times what shows a ratio of one; the eccentricity is at its plausible limit already.
    strong = 3.0 if name != "encoder_eccentricity" else 1.25
    if name == "torque_saturation":
        strong = 4.0
    effect, (weak, clear) = shown(name, (0.02, strong))
    at = effect.seen_at
    assert clear[at] > (0.15 if name == "encoder_eccentricity" else 0.8)
    assert clear[at] > 2.0 * weak[at]
    if name not in SPREAD:
        assert clear[at] == clear.max()


@pytest.mark.parametrize(("name", "joint", "rho"), [("stribeck", 0, 1.0), ("time_delay", 1, 2.0)])
def test_calibration_meets_the_ratio_within_15_percent(name, joint, rho):
    true = world()
    effect = EFFECTS[name](np.random.default_rng(3), true.given, joint)
    wanted = courses("arm2", 8.0, 1)
    calibrated = calibrate(true, effect, wanted, session(true, wanted), rho)
    again = variance(true, session(effect.apply(true, calibrated.strength), wanted), effect.measure)
    assert calibrated.reached
    assert ratio(again, floor(True, effect.measure))[joint] == pytest.approx(rho, rel=0.15)
