"""The simulated robot of a configuration: the first half of `simulate`."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy

from idim_iv_ros.configuration import Configuration, SimulatedRobotSection
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.excitation import Trajectory, require_sampling
from idim_iv_ros.model import DynamicParameters, RobotModel, build_inverse_model
from idim_iv_ros.simulation import (
    ControlLaw,
    SimulatedEffect,
    SimulatedRecording,
    control_law,
    record_simulated_robot,
)
from idim_iv_ros.simulation.effects import joint_effects
from idim_iv_ros.simulators.effects_file import read_effects
from idim_iv_ros.types import FloatArray


@dataclass(frozen=True)
class SimulatedRobot:
    """A robot whose parameters are known."""

    robot: RobotModel  # Kinematics, limits, and the given values, which need not be the true ones
    truth: dict[str, float]  # True base parameters by name, friction and drive inertia included
    parameters: DynamicParameters  # Dynamics that are equivalent to `truth`
    law: ControlLaw
    settings: SimulatedRobotSection  # Noise, rates and delay
    effects: tuple[SimulatedEffect, ...] = ()  # What it has beyond `parameters`

    def record(self, trajectory: Trajectory, seed: int) -> SimulatedRecording:
        """Run a trajectory and record it; `seed` is that of all noise.

        Raises
        ------
        UsageError
            The trajectory is for other joints or too long, or the rates do not fit each other.
        DataError
            The closed loop diverged.
        """
        trajectory = trajectory.in_order(self.robot.joints)
        settings = self.settings
        period = self.law.period or 1.0 / trajectory.rate
        rate = settings.rate or round(1.0 / period, 6)
        require_sampling(max(rate, 1.0 / period), trajectory.duration, "the simulation")
        position, velocity = _resampled(trajectory, rate)
        oversampling = 4 if settings.plant_step is None else round(period / settings.plant_step)
        n = len(trajectory.joints)
        try:
            recording = record_simulated_robot(
                self.robot,
                self.parameters,
                self.law,
                position,
                velocity,
                rate=rate,
                seed=seed,
                position_noise=_levels(settings.position_noise, n),
                torque_noise=_levels(settings.torque_noise, n),
                encoder_resolution=_levels(settings.encoder_resolution, n),
                disturbance=_levels(settings.disturbance, n),
                disturbance_bandwidth=settings.disturbance_bandwidth,
                stamp_jitter=settings.stamp_jitter,
                plant_oversampling=max(oversampling, 1),
                effects=self.effects,
            )
        except ValueError as error:
            raise UsageError(f"simulated_robot.rate: {error}") from error
        if recording.truth.diverged is not None:
            raise DataError(
                f"the simulated robot cannot run this trajectory: {recording.truth.diverged}; "
                "look at the gains, the delay and the parameters"
            )
        return recording


def simulated_robot(
    configuration: Configuration, urdf: str, source: str, extended: Path | None = None
) -> SimulatedRobot:
    """Build the robot that a configuration describes under `simulated_robot`.

    Its model has every friction term and drive inertia, whatever `identification` leaves out. The
    base parameters of a diagnosis (`extended`, a gap.json) take the place of the parameters of the
    configuration, and its causes are added.

    Raises
    ------
    UsageError
        An unknown parameter, a control law that is not known, or a URDF that cannot be used.
    """
    if configuration.signals.effort_unit != "N m":
        raise UsageError("signals.effort_unit: only a robot in N m can be simulated")
    identification = configuration.identification.model_copy(
        update={"friction": ["viscous", "coulomb", "offset"], "drive_inertia": True, "exclude": []}
    )
    whole = configuration.model_copy(update={"identification": identification})
    model = build_inverse_model(whole, urdf, source)
    settings = configuration.simulated_robot
    truth = dict(zip(model.base.names, (float(v) for v in model.given), strict=True))
    for name, value in settings.parameters.items():
        if name not in truth:
            raise UsageError(
                f"{configuration.source or 'configuration'}: simulated_robot.parameters: {name} "
                f"is not a base parameter of this robot; they are {', '.join(truth)}"
            )
        truth[name] = value
    effects: tuple[SimulatedEffect, ...] = ()
    if extended is not None:
        beyond = read_effects(extended)
        truth, effects = beyond.changed(truth), beyond.effects
        joint_effects(effects, model.robot.joints)
    law = control_law(configuration.controller, len(model.robot.joints))
    if settings.delay is not None:
        law = replace(law, delay=settings.delay)
    return SimulatedRobot(
        robot=model.robot,
        truth=truth,
        parameters=model.dynamic_parameters(np.array(list(truth.values()))),
        law=law,
        settings=settings,
        effects=effects,
    )


def _levels(values: list[float] | None, joints: int) -> FloatArray:
    return np.zeros(joints) if values is None else np.asarray(values, dtype=float)


def _resampled(trajectory: Trajectory, rate: float) -> tuple[FloatArray, FloatArray]:
    """Positions and velocities at another rate: cubic between the samples."""
    if abs(rate / trajectory.rate - 1.0) < 1e-9:
        return trajectory.position, trajectory.velocity
    samples = int(np.floor(trajectory.duration * rate + 1e-6)) + 1
    motion = scipy.interpolate.CubicHermiteSpline(
        trajectory.time, trajectory.position, trajectory.velocity
    )
    time = np.minimum(np.arange(samples) / rate, trajectory.time[-1])
    return motion(time), motion(time, 1)
