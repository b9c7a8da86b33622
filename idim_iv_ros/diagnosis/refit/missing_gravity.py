"""Gravity that the configuration itself leaves out, put in before causes are looked for."""

from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.likelihood import Regression
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.held_out import HeldOut
from idim_iv_ros.diagnosis.result import (
    Cause,
    EffectParameter,
    Evidence,
    Gap,
)
from idim_iv_ros.effects.registry import name_of
from idim_iv_ros.model import RobotModel
from idim_iv_ros.simulation import inverse_dynamics
from idim_iv_ros.types import FloatArray

_STANDARD_GRAVITY = 9.81  # m/s², that is put in
_LEAST_GRAVITY = 4.0  # m/s², with the given masses, or it is something else
_MOST_GRAVITY = 25.0  # m/s², the same
_LEAST_SHARE = 0.2  # of the energy of one joint's residual, that gravity takes


def unit_gravity_rows(data: Baseline, accelerations: FloatArray) -> list[FloatArray]:
    """Torque of the given links under each of k gravities (k, 3): (r_j, k) for each joint, N m."""
    robot = data.prepared.model.robot
    tilted = [_with_gravity(robot, acceleration) for acceleration in accelerations]
    bodies = robot.given.of_links
    parts = []
    for motion in data.motions:
        still = np.zeros_like(motion.position)
        torques = [inverse_dynamics(tilt, bodies, motion.position, still, still) for tilt in tilted]
        parts.append(motion.rows(np.concatenate(torques, axis=1)))
    n = len(robot.joints)
    return [data.counting(joint, [part[:, joint::n] for part in parts]) for joint in range(n)]


def _with_gravity(robot: RobotModel, gravity: FloatArray) -> RobotModel:
    model = robot.pinocchio.copy()
    model.gravity.linear = gravity
    return replace(robot, pinocchio=model)


@dataclass(frozen=True)
class MissingGravity:
    """Gravity as the recordings show it.

    Attributes
    ----------
    acceleration, deviation : (3,) m/s²
        In the base frame, with the masses of the nominal model.
    statistic : float
        Wald, with the noise of the model that has gravity: without it a joint's residual is so
        smooth that its noise model takes it for noise, and the likelihood hardly separates them.
    """

    acceleration: FloatArray
    deviation: FloatArray
    statistic: float

    def corrected(self, configuration: Configuration) -> Configuration:
        """Return the configuration with gravity of the usual size in the found direction."""
        vector = _STANDARD_GRAVITY * self.acceleration / np.linalg.norm(self.acceleration)
        robot = configuration.robot.model_copy(update={"gravity": vector.tolist()})
        return configuration.model_copy(update={"robot": robot})

    def cause(self, without: HeldOut, with_gravity: HeldOut) -> Cause:
        """Build the cause from the nominal models without and with gravity."""
        joints = range(len(without.joints))
        before, after = (
            float(np.sqrt(sum(each.rms(0, joint)[0] ** 2 for joint in joints)))
            for each in (without, with_gravity)
        )
        numbers = zip("xyz", self.acceleration, self.deviation, strict=True)
        parameters = {
            f"gravity_{axis}": EffectParameter(float(value), float(std), "m/s²")
            for axis, value, std in numbers
        }
        return Cause(
            effect=name_of("gravity"),
            kind="parametric",
            joint=None,
            other_joint=None,
            parameters=parameters,
            evidence=Evidence(self.statistic),
            indistinguishable_from=(),
            torque_gap=Gap(before, after, None, 1.0 - after / before, None),
            simulation_gap=None,
            sentence=_sentence(self.acceleration),
        )


def missing_gravity(data: Baseline, regression: Regression) -> MissingGravity | None:
    """Look for gravity where the configuration has none; None where it has, or none shows."""
    robot = data.prepared.model.robot
    if np.any(np.asarray(robot.pinocchio.gravity.linear)) or data.prepared.why_no_given:
        return None
    columns = unit_gravity_rows(data, np.eye(3))
    plain = regression.fit()
    heavy = regression.with_columns(dict(enumerate(columns))).fit()
    wald = float(
        heavy.coefficients @ np.linalg.solve(heavy.coefficient_covariance, heavy.coefficients)
    )
    rows = sum(len(joint.torque) for joint in regression.joints)
    size = float(np.linalg.norm(heavy.coefficients))
    less = max(
        1.0 - float(after @ after) / max(float(before @ before), 1e-300)
        for before, after in zip(plain.residuals, heavy.residuals, strict=True)
    )
    if 0.5 * wald - 1.5 * np.log(rows) < settings.LEAST_SUPPORT or less < _LEAST_SHARE:
        return None
    if not _LEAST_GRAVITY <= size <= _MOST_GRAVITY:
        return None
    return MissingGravity(
        acceleration=heavy.coefficients,
        deviation=np.sqrt(np.diag(heavy.coefficient_covariance)),
        statistic=wald,
    )


def _sentence(acceleration: FloatArray) -> str:
    """Gravity (3,) m/s² that the nominal model lacks."""
    found = ", ".join(f"{value:.2g}" for value in acceleration)
    return (
        f"the nominal model has no gravity, but the recordings show it: ({found}) m/s² with the "
        "masses of the nominal model. Everything else was diagnosed with gravity in this direction"
    )
