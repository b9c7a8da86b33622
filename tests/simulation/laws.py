"""Control laws for tests, and an arm that follows its reference under them."""

import numpy as np

from idim_iv_ros.simulation import ControlLaw, simulate_closed_loop


def pd(kp, kd, ki=0.0, *, limit=np.inf, period=None, delay=0.0, feedforward=None):
    """PD law on n joints (the length of kp)."""
    n = len(kp)
    return ControlLaw(
        kp=np.asarray(kp, dtype=float),
        kd=np.asarray(kd, dtype=float),
        ki=np.full(n, ki),
        velocity_reference=True,
        torque_limit=np.full(n, limit),
        period=period,
        delay=delay,
        feedforward=feedforward,
    )


def torque(values):
    """Open loop: the torques (n_samples, n_joints) are applied as they are."""
    values = np.asarray(values, dtype=float)
    return pd(np.zeros(values.shape[1]), np.zeros(values.shape[1]), feedforward=values)


def followed(arm, *effects, law=None, parameters=None, robot=None, **changes):
    """Simulate an arm on its reference, from its start; `changes`: other arguments of the loop."""
    given = {
        "rate": arm.rate,
        "position_reference": arm.position_reference,
        "velocity_reference": arm.velocity_reference,
        "initial_position": arm.position_reference[0],
        "initial_velocity": arm.velocity_reference[0],
        "effects": effects,
    }
    return simulate_closed_loop(
        robot or arm.robot, parameters or arm.truth, law or arm.law, **(given | changes)
    )


def driven(robot, parameters, torques, *effects, rate=1000.0, law=None, **changes):
    """Simulate a robot from rest at zero under torques (n_samples,) or (n_samples, n_joints)."""
    torques = np.asarray(torques, dtype=float)
    n = len(robot.joints)
    if torques.ndim == 1:
        torques = np.repeat(torques[:, None], n, axis=1)
    given = {
        "rate": rate,
        "position_reference": np.zeros_like(torques),
        "initial_position": np.zeros(n),
        "initial_velocity": np.zeros(n),
        "effects": effects,
    }
    return simulate_closed_loop(robot, parameters, law or torque(torques), **(given | changes))


def commanded(arm, result, kp=None):
    """Torques (n_samples, n_joints) of the arm's PD law for what the encoders show."""
    error = arm.position_reference - result.measured_position
    slip = arm.velocity_reference - result.measured_velocity
    return (arm.law.kp if kp is None else kp) * error + arm.law.kd * slip
