"""Torques and heights from pinocchio alone: nothing of the package's own kernels."""

import numpy as np
import pinocchio as pin


def torques(model, motion) -> np.ndarray:
    """Rigid bodies, drives, friction: (n_samples, n_joints) N m."""
    robot, given = model.robot, model.robot.given
    data, order = robot.pinocchio.createData(), robot.order
    signals = [s[:, order] for s in (motion.position, motion.velocity, motion.acceleration)]
    rigid = np.array([pin.rnea(robot.pinocchio, data, *row) for row in zip(*signals, strict=True)])
    drives = given.drive_inertia * motion.acceleration
    friction = given.viscous * motion.velocity + given.coulomb * np.sign(motion.velocity)
    return rigid[:, np.argsort(order)] + drives + friction


def lowest(model, motion) -> float:
    """Least height of all frames that move, m."""
    robot = model.robot
    data = robot.pinocchio.createData()
    moving = [i for i, frame in enumerate(robot.pinocchio.frames) if frame.parentJoint > 0]
    height = np.inf
    for q in motion.position[:, robot.order]:
        pin.framesForwardKinematics(robot.pinocchio, data, q)
        height = min(height, *(data.oMf[i].translation[2] for i in moving))
    return float(height)


def assert_limits_hold(model, limits, motion) -> None:
    """Every limit at every sample, with the margin."""
    share = limits.margin * (1.0 + 1e-6)
    assert np.all(np.abs(motion.position - limits.middle) <= share * limits.half_range)
    assert np.all(np.abs(motion.velocity) <= share * limits.velocity)
    assert np.all(np.abs(motion.acceleration) <= share * limits.acceleration)
    assert np.all(np.abs(torques(model, motion)) <= share * limits.torque)
    if limits.floor is not None:
        assert lowest(model, motion) > limits.floor


def assert_signals_agree(motion) -> None:
    """Velocity and acceleration are the derivatives of the position (trapezoidal rule)."""
    for integral, slope in (
        (motion.position, motion.velocity),
        (motion.velocity, motion.acceleration),
    ):
        mean = 0.5 * (slope[1:] + slope[:-1])
        step = np.diff(integral, axis=0) * motion.rate
        np.testing.assert_allclose(step, mean, atol=0.02 * np.abs(slope).max())
