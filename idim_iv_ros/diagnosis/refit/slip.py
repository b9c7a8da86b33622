"""Dry friction of the simulated joints: between its levels while a joint sticks.

At a reversal an ideal dry friction does not jump: the joint rests while the torque that holds it
crosses from one level to the other. A model with the sign of the speed is wrong there by as much
as the friction, for tens of milliseconds, and filters smear that over the rows around.
"""

import numpy as np

from idim_iv_ros.estimation.idim_iv import IdimIvEstimate
from idim_iv_ros.estimation.instruments import SimulatedLoop
from idim_iv_ros.identification.prepare import PreparedRegression
from idim_iv_ros.model import InverseModel
from idim_iv_ros.signals import Motion
from idim_iv_ros.simulation import ControlLaw, inverse_dynamics
from idim_iv_ros.simulation.replay import replay
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
    parameters = model.dynamic_parameters(values)
    result = replay(model.robot, parameters, law, motion)
    if result.diverged is not None:
        return None
    slippery = parameters.without_dry_friction
    rest = inverse_dynamics(
        model.robot, slippery, result.position, result.velocity, result.acceleration
    )
    friction = result.applied_torque - rest
    sticking = result.velocity == 0.0
    level = np.maximum(parameters.coulomb, 0.0)
    share = np.clip(friction / np.where(level > 0.0, level, 1.0), -1.0, 1.0)
    slip = np.where(sticking & (level > 0.0), share, np.sign(result.velocity))
    return np.asarray(slip[motion.span])
