"""Errors of links beside which causes are estimated are those of bodies: as pinocchio has them."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.stats import norm

from bags.simulated_arms import arm6
from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.parametric.change_regression import change_regression
from idim_iv_ros.diagnosis.parametric.other_errors import (
    Beside,
    errors_of_drives,
    errors_of_links,
    estimated_beside_other_errors,
)
from idim_iv_ros.diagnosis.refit.baseline import baseline, smooth_regression
from idim_iv_ros.effects.payload import Payload
from idim_iv_ros.model import InverseModel, build_inverse_model
from tests.estimation.test_simulated_arms import recorded

MASS, CENTRE = 0, slice(1, 4)  # of the ten errors of each link


@pytest.fixture(scope="module")
def model() -> InverseModel:
    configuration = arm6(seconds=1.0).configuration
    urdf = configuration.robot.urdf
    assert urdf is not None
    return build_inverse_model(configuration, urdf.read_text(encoding="utf-8"), urdf.name)


def vector(model: InverseModel, joint: int, link: pin.Inertia) -> np.ndarray:
    """Standard parameters with one link exchanged."""
    given = model.robot.given
    inertial = given.inertial.copy()
    inertial[joint] = link.toDynamicParameters()
    return np.asarray(
        model.regressor.layout.vector(type(given)(**{**vars(given), "inertial": inertial}))
    )


@pytest.mark.parametrize("joint", [0, 3, 5])
def test_a_link_with_another_centre_of_mass(model: InverseModel, joint: int) -> None:
    link = pin.Inertia.FromDynamicParameters(model.robot.given.inertial[joint])
    errors = errors_of_links(model)[:, 10 * joint : 10 * joint + 10][:, CENTRE]
    places = [model.regressor.layout.names.index(f"M{axis}{joint + 1}") for axis in "XYZ"]
    for axis, error in enumerate(errors.T):
        length = error[places[axis]] / link.mass  # m, of an error of size one
        step = 1e-6 * np.eye(3)[axis]
        moved, back = (
            vector(model, joint, pin.Inertia(link.mass, link.lever + sign * step, link.inertia))
            for sign in (1.0, -1.0)
        )
        assert error == pytest.approx(length * (moved - back) / 2e-6, abs=1e-9)


def test_a_heavier_link_has_larger_moments_too(model: InverseModel) -> None:
    given = model.robot.given
    link = pin.Inertia.FromDynamicParameters(given.inertial[5])
    heavier = vector(model, 5, pin.Inertia(1.1 * link.mass, link.lever, 1.1 * link.inertia))
    error = errors_of_links(model)[:, 50 + MASS]
    assert 0.1 * error == pytest.approx(heavier - model.regressor.layout.vector(given), abs=1e-12)


def test_links_and_drives_share_no_parameter(model: InverseModel) -> None:
    links, drives = errors_of_links(model), errors_of_drives(model)
    assert not np.any(np.any(links != 0.0, axis=1) & np.any(drives != 0.0, axis=1))
    assert np.all(np.any(links != 0.0, axis=1) | np.any(drives != 0.0, axis=1))


def test_a_test_over_what_the_errors_may_be_is_the_mean_of_their_tests() -> None:
    beside = Beside(
        (), np.array([0.9, 0.1]), np.array([[5.0], [2.0]]), np.array([[[1.0]], [[4.0]]])
    )
    expected = 0.9 * 2.0 * norm.sf(5.0) + 0.1 * 2.0 * norm.sf(1.0)
    assert beside.p_value(slice(0, 1)) == pytest.approx(expected, rel=1e-12)


def test_masses_that_are_off_while_shapes_are_known_are_no_payload() -> None:
    arm = arm6(seconds=8.0)
    data = baseline([recorded(arm, 1)], arm.configuration)
    regression = smooth_regression(data)
    given = change_regression(data, regression, regression.fit())
    model, random = given.space.model, np.random.default_rng(3)
    masses = errors_of_links(model)[:, ::10]
    payload = Payload().variants(given.space, 5)[0]
    base = given.factor[:, : len(given.space.given)] @ model.base.grouping
    held, named = 0, 0
    for _ in range(20):
        error = masses @ (0.1 * random.choice([-1.0, 1.0], 6))
        right = base @ error + random.standard_normal(len(given.right))
        beside = estimated_beside_other_errors(replace(given, right=right), payload)
        mass = beside.found[0]
        assert mass.change.name == "mass"
        assert mass.std is not None
        held += abs(mass.value) <= 1.96 * mass.std
        named += beside.p_value(slice(0, 4)) <= settings.PARAMETRIC_LEVEL
    assert held >= 17
    assert named <= 1


def test_a_body_holds_what_its_own_link_is_off_by() -> None:
    """A link that is 10 % too heavy is a payload of as much, where it has no error of its own."""
    arm = arm6(seconds=8.0)
    data = baseline([recorded(arm, 1)], arm.configuration)
    regression = smooth_regression(data)
    given = change_regression(data, regression, regression.fit())
    model, random = given.space.model, np.random.default_rng(5)
    body = Payload().variants(given.space, 5)[-1]
    place = [change.name for change in body].index("mass")
    base = given.factor[:, : len(given.space.given)] @ model.base.grouping
    error = 0.1 * errors_of_links(model)[:, 50 + MASS]
    changes = replace(given, right=base @ error + random.standard_normal(len(given.right)))
    added = 0.1 * float(model.robot.given.inertial[5, 0])
    with_link = estimated_beside_other_errors(changes, body, {5}).found[place]
    without = estimated_beside_other_errors(changes, body).found[place]
    exact = estimated_beside_other_errors(changes, body, one_size=True).found[place]
    assert with_link.std is not None and without.std is not None and exact.std is not None
    assert abs(with_link.value - added) <= 1.96 * with_link.std
    assert with_link.std < 0.95 * without.std
    # Friction and drives are exact: errors of the same size hardly move the mass.
    assert exact.std < 0.5 * without.std
