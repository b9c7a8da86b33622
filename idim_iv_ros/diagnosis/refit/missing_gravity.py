"""Gravity that the configuration itself leaves out, put in before causes are looked for."""

from dataclasses import dataclass

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis import sentences, settings
from idim_iv_ros.diagnosis.held_out.held_out import HeldOut
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.gravity_rows import unit_gravity_rows
from idim_iv_ros.diagnosis.result import (
    NOT_CALIBRATED,
    Cause,
    EffectParameter,
    Evidence,
    Gap,
)
from idim_iv_ros.diagnosis.structural.likelihood import Regression
from idim_iv_ros.effects.registry import name_of
from idim_iv_ros.types import FloatArray


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
        vector = settings.STANDARD_GRAVITY * self.acceleration / np.linalg.norm(self.acceleration)
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
            evidence=Evidence(self.statistic, None, None, "", p_value_from=NOT_CALIBRATED),
            indistinguishable_from=(),
            torque_gap=Gap(before, after, None, 1.0 - after / before, None),
            simulation_gap=None,
            sentence=sentences.missing_gravity(self.acceleration),
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
    if (
        0.5 * wald - 1.5 * np.log(rows) < settings.LEAST_SUPPORT
        or less < settings.GRAVITY_LEAST_SHARE
    ):
        return None
    if not settings.LEAST_GRAVITY <= size <= settings.MOST_GRAVITY:
        return None
    return MissingGravity(
        acceleration=heavy.coefficients,
        deviation=np.sqrt(np.diag(heavy.coefficient_covariance)),
        statistic=wald,
    )
