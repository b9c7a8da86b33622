"""Errors of links beside which causes are estimated are those of bodies: as pinocchio has them."""

import numpy as np
import pinocchio as pin
import pytest

from bags.simulated_arms import arm6
from idim_iv_ros.diagnosis.parametric.other_errors import errors_of_drives, errors_of_links
from idim_iv_ros.model import InverseModel, build_inverse_model

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
