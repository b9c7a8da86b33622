"""Dry friction of the simulated joints: between its levels while a joint sticks.

At a reversal an ideal dry friction does not jump: the joint rests while the torque that holds it
crosses from one level to the other. A model with the sign of the speed is wrong there by as much
as the friction, for tens of milliseconds, and filters smear that over the rows around.
"""

from dataclasses import replace

import numpy as np

from idim_iv_ros.estimation.idim_iv import IdimIvEstimate
from idim_iv_ros.estimation.instruments import SimulatedLoop
from idim_iv_ros.identification.prepare import PreparedRegression
from idim_iv_ros.model import InverseModel
from idim_iv_ros.signals import Motion, central_differences
from idim_iv_ros.simulation import ControlLaw, inverse_dynamics, simulate_closed_loop
from idim_iv_ros.types import FloatArray


def simulated_slips(
    prepared: PreparedRegression, estimate: IdimIvEstimate
) -> tuple[FloatArray | None, ...]:
    """Friction of each recording's span as a share of its level, (n_samples, n_joints), −1 to 1.

    None where the closed loop is not simulated.
    """
    source = estimate.source
    if not isinstance(source, SimulatedLoop):
        return tuple(None for _ in prepared.motions)
    return tuple(
        _slip(source.model, estimate.linear.values, motion, law)
        for motion, law in zip(source.motions, source.laws, strict=True)
    )


def _slip(
    model: InverseModel, values: FloatArray, motion: Motion, law: ControlLaw
) -> FloatArray | None:
    signals = motion.signals
    if signals.position_reference is None:
        return None
    velocity, _ = central_differences(motion.position, rate=signals.rate, start=0, stop=1)
    parameters = model.dynamic_parameters(values)
    result = simulate_closed_loop(
        model.robot,
        parameters,
        law,
        rate=signals.rate,
        position_reference=signals.position_reference,
        velocity_reference=signals.velocity_reference,
        initial_position=motion.position[0],
        initial_velocity=velocity[0],
    )
    if result.diverged is not None:
        return None
    nothing = np.zeros_like(parameters.coulomb)
    slippery = replace(parameters, coulomb=nothing)
    rest = inverse_dynamics(
        model.robot, slippery, result.position, result.velocity, result.acceleration
    )
    friction = result.applied_torque - rest
    sticking = result.velocity == 0.0
    level = np.maximum(parameters.coulomb, 0.0)
    share = np.clip(friction / np.where(level > 0.0, level, 1.0), -1.0, 1.0)
    slip = np.where(sticking & (level > 0.0), share, np.sign(result.velocity))
    return np.asarray(slip[motion.span])
