"""Errors of signals and mounting: what they make, against inverse dynamics."""

from dataclasses import replace

import numpy as np

from bags.simulated_arms import SimulatedArm, arm2, arm6
from idim_iv_ros.diagnosis.comparison.signals import CommonShift, TiltedMoments
from idim_iv_ros.diagnosis.refit.smooth_motion import SmoothMotion
from idim_iv_ros.effects.effect import Place, Shape
from idim_iv_ros.simulation import inverse_dynamics
from tests.diagnosis.motions import smooth_motion, synthetic

RATE = 200.0


def moving(arm: SimulatedArm, seconds: float = 5.0) -> SmoothMotion:
    """All joints on a sine of their own."""
    time = np.arange(round(seconds * RATE)) / RATE
    pulsation = np.linspace(1.3, 4.1, len(arm.robot.joints))
    angle = time[:, None] * pulsation
    return smooth_motion(
        arm,
        0.2 + 0.6 * np.sin(angle),
        0.6 * pulsation * np.cos(angle),
        -0.6 * pulsation**2 * np.sin(angle),
        RATE,
    )


def test_moments_that_gravity_does_not_show_turn_with_the_first_joint_under_a_tilt() -> None:
    """Of arm6, whose first axis is vertical: a link 1 whose mass lies elsewhere."""
    motion = moving(arm6(seconds=1.0))
    other = motion.links.inertial.copy()
    other[0, 1:3] += [0.4, -0.7]  # first moments about the vertical axis, kg m
    moved = replace(motion.links, inertial=other)
    tilted = motion.robot.pinocchio.copy()
    tilted.gravity.linear = np.array([0.3, -0.5, -9.78])
    torques = [
        inverse_dynamics(
            replace(motion.robot, pinocchio=model),
            links,
            motion.position,
            np.zeros_like(motion.position),
            np.zeros_like(motion.position),
        )
        for model in (motion.robot.pinocchio, tilted)
        for links in (motion.links, moved)
    ]
    level, slanting = torques[1] - torques[0], torques[3] - torques[2]
    np.testing.assert_allclose(level, 0.0, atol=1e-9)
    assert np.ptp(slanting[:, 0]) > 0.1
    np.testing.assert_allclose(slanting[:, 1:], 0.0, atol=1e-9)
    (columns,) = TiltedMoments().columns(motion, Place(0), Shape()).values()
    solution = np.linalg.lstsq(columns, slanting[:, 0], rcond=None)[0]
    np.testing.assert_allclose(columns @ solution, slanting[:, 0], atol=1e-9)


def test_where_gravity_shows_them_they_are_base_parameters() -> None:
    """The first axis of arm2 is level."""
    (columns,) = TiltedMoments().columns(moving(arm2(seconds=1.0)), Place(0), Shape()).values()
    assert not columns.any()


def test_a_shift_of_all_efforts_is_the_rate_of_their_torques() -> None:
    """τ(t + s) − τ(t) = s dτ/dt at every joint, one coefficient; of one joint it is a delay."""
    motion = synthetic()
    columns = CommonShift().columns(motion, Place(0), Shape())
    assert set(columns) == {0, 1}
    smooth = replace(motion, slip=np.zeros_like(motion.slip))
    shift = 1e-3
    for joint, rate in CommonShift().columns(smooth, Place(0), Shape()).items():
        later = np.interp(smooth.time + shift, smooth.time, smooth.torque[:, joint])
        inner = slice(5, -5)
        error = later[inner] - smooth.torque[inner, joint] - shift * rate[inner, 0]
        assert np.abs(error).max() < 0.05 * np.abs(shift * rate).max()
    assert CommonShift().places(1) == []
