"""The links of a result as rigid bodies, nearest to what was estimated."""

from dataclasses import replace

import cvxpy
import numpy as np
import pinocchio as pin
import pytest

from idim_iv_ros.model.parameters import INERTIAL, REGRESSOR_ORDER
from idim_iv_ros.physical import PhysicalParameters, nearest_physical
from idim_iv_ros.physical.nearest import LEAST_OF_NOMINAL, TIE_BREAKER
from idim_iv_ros.physical.pseudo_inertia import inertial_parameters, pseudo_inertia
from idim_iv_ros.physical.remainder import Remainder, spread_remainder
from idim_iv_ros.types import FloatArray
from tests.physical.arms import Estimate, arm


def projected(estimate: Estimate, values: FloatArray) -> PhysicalParameters:
    model = estimate.model
    return nearest_physical(model.robot, model.base, values, estimate.covariance)


def of_link(nearest: PhysicalParameters, joint: int) -> FloatArray:
    return np.array([nearest.values[f"{kind}{joint + 1}"] for kind in INERTIAL])


def test_the_pseudo_inertia_of_a_link_is_pinocchios() -> None:
    body = pin.Inertia.Random()
    dynamic = body.toDynamicParameters()
    parameters = dynamic[list(REGRESSOR_ORDER)]
    matrix = pin.PseudoInertia.FromInertia(body).toMatrix()
    np.testing.assert_allclose(pseudo_inertia(parameters), matrix, atol=1e-12)
    np.testing.assert_allclose(inertial_parameters(matrix), parameters, atol=1e-12)


def test_the_nominal_model_is_the_set_nearest_to_itself() -> None:
    estimate = arm("arm7", samples=400, noise=0.01)
    nearest = projected(estimate, estimate.model.given)
    layout = estimate.model.regressor.layout
    nominal = layout.vector(estimate.model.robot.given)
    values = np.array([nearest.values[name] for name in layout.names])
    np.testing.assert_allclose(values, nominal, atol=2e-4)
    assert nearest.test.statistic == pytest.approx(0.0, abs=1e-6)
    assert nearest.active == ()


def test_links_of_noisy_estimates_are_bodies() -> None:
    estimate = arm("arm7", samples=200, noise=0.02)
    nearest = projected(estimate, estimate.drawn(0))
    assert min(entry.smallest_before for entry in nearest.links) < 0.0
    for joint in range(7):
        body = pin.Inertia.FromDynamicParameters(
            of_link(nearest, joint)[np.argsort(REGRESSOR_ORDER)]
        )
        moments = np.linalg.eigvalsh(body.inertia)
        assert body.mass > 0.0 and moments[0] > 0.0 and moments[2] < moments[0] + moments[1]
    for name, value in nearest.values.items():
        assert not name.startswith(("Ia", "Fv", "Fc")) or value >= 0.0


@pytest.mark.parametrize("shared", [(), ("Fv2", "Fc2")])
def test_negative_friction_is_held_at_zero_and_named_unless_an_effect_shares_it(shared) -> None:
    """A drag may make up for it; links and the other joint's friction are bounded as ever."""
    estimate = arm("arm2", samples=500, noise=0.01)
    model, values = estimate.model, estimate.true.copy()
    values[model.base.names.index("Fv2")] = -5.0
    nearest = nearest_physical(model.robot, model.base, values, estimate.covariance, shared=shared)
    assert nearest.shared == shared
    if shared:
        assert nearest.values["Fv2"] == pytest.approx(-5.0, rel=1e-3)
        assert nearest.active == () and "Fv2" in nearest.sentence
        return
    assert nearest.values["Fv2"] == 0.0
    assert "Fv2" in nearest.active
    assert nearest.test.p_value is not None and nearest.test.p_value < 1e-6


def test_what_no_motion_shows_is_that_of_the_nominal_model() -> None:
    """An arm on the ground: of its first link only the moment about its axis enters the torque."""
    estimate = arm("arm7", samples=400, noise=0.01)
    nearest = projected(estimate, estimate.true)
    sources = {entry.name: entry.source for entry in nearest.parameters}
    unseen = {f"{kind}1" for kind in INERTIAL if kind != "ZZ"}
    assert {name for name, source in sources.items() if source == "nominal model"} == unseen
    assert sources["Fv3"] == sources["Ia3"] == "recording"
    assert sources["M2"] == "recording and nominal model"
    assert all(entry.std is None for entry in nearest.parameters if entry.source == "nominal model")


def test_the_optimum_is_that_of_a_modelling_language() -> None:
    """The same problem posed in cvxpy and solved by SCS, another algorithm than clarabel's."""
    estimate = arm("arm2", samples=100, noise=0.02)
    model, values = estimate.model, estimate.drawn(5)
    values[model.base.names.index("Fc1")] = -1.0
    nearest = projected(estimate, values)
    layout = model.regressor.layout
    standard = cvxpy.Variable(len(layout.names))
    nominal = layout.vector(model.robot.given)
    divergence, constraints = 0.0, []
    for joint in range(2):
        place = [layout.names.index(f"{kind}{joint + 1}") for kind in INERTIAL]
        xx, xy, xz, yy, yz, zz, mx, my, mz, m = (standard[k] for k in place)
        half = (xx + yy + zz) / 2.0
        matrix = cvxpy.bmat([
            [half - xx, -xy, -xz, mx],
            [-xy, half - yy, -yz, my],
            [-xz, -yz, half - zz, mz],
            [mx, my, mz, m],
        ])  # fmt: skip
        root = np.linalg.inv(np.linalg.cholesky(pseudo_inertia(nominal[place])))
        relative = root @ matrix @ root.T
        divergence += cvxpy.trace(relative) - cvxpy.log_det(relative)
        constraints.append(relative - LEAST_OF_NOMINAL * np.eye(4) >> 0)
    for k, entry in enumerate(layout.parameters):
        if entry.kind in ("Ia", "Fv", "Fc"):
            constraints.append(standard[k] >= 0.0)
    # Ia1 alone is part of a sum: YY1 + Ia1 + 0.1764 M2.
    drive, total = layout.names.index("Ia1"), values[model.base.names.index("YY1")]
    divergence += cvxpy.square((standard[drive] - nominal[drive]) / max(nominal[drive], total))
    whitening = np.linalg.inv(np.linalg.cholesky(estimate.covariance))
    distance = cvxpy.sum_squares(whitening @ (model.base.grouping @ standard - values))
    problem = cvxpy.Problem(cvxpy.Minimize(distance + TIE_BREAKER * divergence), constraints)
    problem.solve(solver="SCS", eps=1e-7, max_iters=200_000)
    base = np.array([entry.value for entry in nearest.base])
    std = np.sqrt(np.diag(estimate.covariance))
    np.testing.assert_allclose(
        base / std, model.base.grouping @ standard.value / std, atol=0.02, rtol=0.0
    )
    assert nearest.test.statistic == pytest.approx(float(distance.value), rel=1e-3)


def test_the_deviations_are_those_of_repeated_recordings() -> None:
    """Of a parameter that the recording shows, and of the mass that is only part of sums."""
    estimate = arm("arm2", samples=2000, noise=0.002)
    draws = [projected(estimate, estimate.drawn(seed)) for seed in range(60)]
    for name in ("Fv2", "Ia2", "MX2", "YY2"):
        spread = float(np.std([entry.values[name] for entry in draws]))
        said = {entry.name: entry.std for entry in draws[0].parameters}[name]
        assert 0.75 * spread < said < 1.35 * spread


def test_the_test_of_a_true_robot_rejects_no_more_often_than_it_says() -> None:
    estimate = arm("arm2", samples=50, noise=0.05)
    p_values = [projected(estimate, estimate.drawn(seed)).test.p_value for seed in range(100)]
    assert sum(entry is not None and entry < 0.05 for entry in p_values) <= 10


def test_a_rough_nominal_model_does_not_hold_back_what_the_recording_shows() -> None:
    """Nominal masses of a tenth, and no friction: the estimate is kept all the same."""
    estimate = arm("arm6", samples=2000, noise=0.002)
    robot = estimate.model.robot
    given = replace(robot.given, inertial=0.1 * robot.given.inertial).without_friction
    rough = replace(robot, given=given)
    nearest = nearest_physical(rough, estimate.model.base, estimate.true, estimate.covariance)
    assert nearest.test.statistic is not None and nearest.test.statistic < 1.0


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
