"""The compiled rigid-body dynamics agree with pinocchio, and hold for unphysical parameters."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

from idim_iv_ros.model.parameters import parameter_layout
from idim_iv_ros.model.regressor import StandardRegressor
from idim_iv_ros.simulation import inverse_dynamics, mass_matrix
from tests.simulation.trees import TREES, frictionless, random_robot


@pytest.fixture(params=TREES, ids=lambda name: name.replace(" ", "-"))
def robot(request):
    return random_robot(3, *TREES[request.param])


def states(robot, seed=0, samples=5):
    rng = np.random.default_rng(seed)
    return (
        rng.normal(size=(3, samples, len(robot.joints))) * np.array([2.0, 3.0, 5.0])[:, None, None]
    )


def test_torque_of_a_motion_is_that_of_pinocchio(robot):
    q, dq, ddq = states(robot)
    torque = inverse_dynamics(robot, robot.given, q, dq, ddq)
    data = robot.pinocchio.createData()
    for k in range(len(q)):
        expected = pin.rnea(robot.pinocchio, data, *(x[k, robot.order] for x in (q, dq, ddq)))
        np.testing.assert_allclose(torque[k, robot.order], expected, rtol=1e-11, atol=1e-10)


def test_mass_matrix_is_that_of_pinocchio(robot):
    q, _, _ = states(robot)
    mass = mass_matrix(robot, robot.given, q)
    data = robot.pinocchio.createData()
    for k in range(len(q)):
        upper = np.triu(pin.crba(robot.pinocchio, data, q[k, robot.order]))
        expected = upper + np.triu(upper, 1).T
        actual = mass[k][np.ix_(robot.order, robot.order)]
        np.testing.assert_allclose(actual, expected, rtol=1e-11, atol=1e-10)


def test_unphysical_parameters_act_linearly_as_in_the_regressor(robot):
    n = len(robot.joints)
    rng = np.random.default_rng(7)
    inertial = rng.normal(size=(n, 10))
    inertial[:, 0] = 0.0
    parameters = dataclasses.replace(
        frictionless(inertial),
        drive_inertia=rng.normal(size=n),
        viscous=rng.normal(size=n),
        coulomb=rng.normal(size=n),
        offset=rng.normal(size=n),
    )
    layout = parameter_layout(
        robot.joint_types, friction=("viscous", "coulomb", "offset"), drive_inertia=True
    )
    q, dq, ddq = states(robot)
    expected = StandardRegressor(robot, layout)(q, dq, ddq) @ layout.vector(parameters)
    torque = inverse_dynamics(robot, parameters, q, dq, ddq)
    np.testing.assert_allclose(torque, expected, rtol=1e-10, atol=1e-9)


def test_transmission_coupling_acts_as_in_the_regressor():
    robot = random_robot(5, *TREES["serial"])
    layout = parameter_layout(
        robot.joint_types,
        friction=("viscous", "coulomb", "offset"),
        drive_inertia=True,
        couplings=[(4, 5)],
    )
    values = np.random.default_rng(1).normal(size=len(layout.parameters))
    q, dq, ddq = states(robot)
    expected = StandardRegressor(robot, layout)(q, dq, ddq) @ values
    torque = inverse_dynamics(robot, layout.dynamic_parameters(values), q, dq, ddq)
    np.testing.assert_allclose(torque, expected, rtol=1e-10, atol=1e-9)
