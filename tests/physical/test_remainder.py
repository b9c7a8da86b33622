"""What no cause explains, spread over links and drives as far as an estimate asks for it."""

import numpy as np
import pytest

from idim_iv_ros.model.parameters import INERTIAL
from idim_iv_ros.physical.pseudo_inertia import pseudo_inertia
from idim_iv_ros.physical.remainder import Remainder, spread_remainder
from idim_iv_ros.types import FloatArray
from tests.physical.arms import arm

BALL = np.array([2.6e-3, 0.0, 0.0, 2.6e-3, 0.0, 5e-4, 0.0, 0.0, 0.04, 0.8])
ESTIMATE = arm("arm7", samples=4000, noise=0.001)
LAYOUT = ESTIMATE.model.regressor.layout
NOMINAL = LAYOUT.vector(ESTIMATE.model.robot.given)


def link(joint: int) -> list[int]:
    return [LAYOUT.names.index(f"{kind}{joint}") for kind in INERTIAL]


def spread(
    standard: FloatArray, *, seed: int, load: FloatArray | None = None, **named: float
) -> Remainder:
    """Of the estimate that a robot with these parameters has; `load`: what the causes say."""
    model, true = ESTIMATE.model, standard.copy()
    if load is not None:
        true[link(7)] += BALL
    start = NOMINAL.copy()
    for name, value in named.items():
        start[LAYOUT.names.index(name)] = value
    noise = np.random.default_rng(seed).normal(size=len(ESTIMATE.true))
    values = model.base.grouping @ true + np.linalg.cholesky(ESTIMATE.covariance) @ noise
    loads = [] if load is None else [(6, load)]
    return spread_remainder(
        model.robot, model.base, values, ESTIMATE.covariance, start, loads, set(named), ()
    )


@pytest.mark.parametrize("seed", range(2))
def test_an_exact_nominal_model_stays(seed: int) -> None:
    remainder = spread(NOMINAL, seed=seed)
    masses = [LAYOUT.names.index(f"M{joint}") for joint in range(1, 8)]
    np.testing.assert_allclose(remainder.standard[masses[1:]], NOMINAL[masses[1:]], rtol=0.01)
    assert np.median(remainder.links) == 0.0 and remainder.links[1:].max() < 0.03


@pytest.mark.parametrize("seed", range(2))
def test_one_heavier_link_is_found_and_the_others_stay(seed: int) -> None:
    true = NOMINAL.copy()
    true[link(3)] *= 1.12
    remainder = spread(true, seed=seed)
    assert remainder.links.argmax() == 2
    assert remainder.standard[link(3)[-1]] == pytest.approx(true[link(3)[-1]], rel=0.04)
    for joint in (4, 5, 6, 7):
        assert remainder.standard[link(joint)[-1]] == pytest.approx(
            NOMINAL[link(joint)[-1]], rel=0.03
        )


def test_a_load_is_a_body_of_its_own_and_named_numbers_are_left_to_the_estimate() -> None:
    true = NOMINAL.copy()
    true[LAYOUT.names.index("Fc4")] += 3.0
    start = true[LAYOUT.names.index("Fc4")] - 0.5
    remainder = spread(true, seed=1, load=1.1 * BALL, Fc4=float(start))
    assert remainder.standard[LAYOUT.names.index("Fc4")] == pytest.approx(start + 0.5, rel=0.01)
    assert remainder.loads[0][-1] == pytest.approx(0.8, abs=0.05)
    assert np.linalg.eigvalsh(pseudo_inertia(remainder.loads[0]))[0] > 0.0
    np.testing.assert_allclose(remainder.standard[link(7)], NOMINAL[link(7)], rtol=0.05, atol=1e-3)
