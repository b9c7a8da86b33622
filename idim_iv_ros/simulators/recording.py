"""Simulated robots, and bags as a recorder would write them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from idim_iv_ros import files
from idim_iv_ros.configuration import Configuration
from idim_iv_ros.encoding import json_text
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.excitation.trajectory import Trajectory, require_sampling
from idim_iv_ros.files import FilePath
from idim_iv_ros.model import DynamicParameters, RobotModel, build_inverse_model, read_urdf_file
from idim_iv_ros.progress import Progress, Stopwatch
from idim_iv_ros.recording.writing.write import JointTopic, write_messages
from idim_iv_ros.signal_source import topic_of
from idim_iv_ros.simulation import (
    ControlLaw,
    SimulatedEffect,
    SimulatedRecording,
    control_law,
    record_simulated_robot,
)
from idim_iv_ros.simulation.effects import contributions_of
from idim_iv_ros.simulators.effects_file import EffectsFile, read_effects
from idim_iv_ros.types import FloatArray

# Keys of the section `simulated_robot` that concern the recorder.
_NOISE = {
    *("position_noise", "torque_noise", "encoder_resolution"),
    *("disturbance", "disturbance_bandwidth", "stamp_jitter"),
}


@dataclass(frozen=True)
class SimulatedRobot:
    """A robot with known true parameters, to be simulated."""

    robot: RobotModel  # Kinematics, limits, and the given values, which need not be the true ones
    truth: dict[str, float]  # True base parameters by name, friction and drive inertia included
    parameters: DynamicParameters  # Dynamics that are equivalent to `truth`
    law: ControlLaw
    configuration: Configuration
    description: str  # URDF of the nominal model
    effects: tuple[SimulatedEffect, ...] = ()  # What it has beyond `parameters`

    def record(self, trajectory: Trajectory, seed: int) -> SimulatedRecording:
        """Simulate a trajectory and return its record; `seed` is that of all noise.

        Raises UsageError: the trajectory is for other joints or too long, or the rates do not fit
        each other. DataError: the closed loop diverged.
        """
        trajectory = trajectory.in_order(self.robot.joints)
        settings = self.configuration.simulated_robot
        period = self.law.period or 1.0 / trajectory.rate
        rate = settings.rate or round(1.0 / period, 6)
        require_sampling(max(rate, 1.0 / period), trajectory.duration, "the simulation")
        position, velocity = trajectory.position, trajectory.velocity
        if abs(rate / trajectory.rate - 1.0) >= 1e-9:
            samples = int(np.floor(trajectory.duration * rate + 1e-6)) + 1
            motion = scipy.interpolate.CubicHermiteSpline(trajectory.time, position, velocity)
            time = np.minimum(np.arange(samples) / rate, trajectory.time[-1])
            position, velocity = motion(time), motion(time, 1)
        oversampling = 4 if settings.plant_step is None else round(period / settings.plant_step)
        levels = settings.model_dump(include=_NOISE, exclude_none=True)
        noise: dict[str, Any] = {name: np.asarray(level) for name, level in levels.items()}
        try:
            recording = record_simulated_robot(
                self.robot,
                self.parameters,
                self.law,
                position,
                velocity,
                rate=rate,
                seed=seed,
                **noise,
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
    configuration: Configuration, extended: FilePath | None = None
) -> SimulatedRobot:
    """Return the robot that a configuration describes under `simulated_robot`.

    Its model has every friction term and drive inertia, whatever `identification` leaves out. With
    the extended model of a diagnosis (`extended`, a gap.json), that has precedence over the
    parameters of the configuration, and its causes are added.

    Raises UsageError: an unknown parameter, a control law that is not known, no URDF, or one that
    cannot be used.
    """
    urdf = configuration.robot.description
    if urdf is None:
        raise UsageError(f"{configuration.source}: robot.urdf or robot.mjcf is needed to simulate")
    if configuration.signals.effort_unit != "N m":
        raise UsageError("signals.effort_unit: only a robot in N m can be simulated")
    terms = ["viscous", "coulomb", "offset"]
    whole = configuration.changed("identification", friction=terms, drive_inertia=True, exclude=[])
    text = read_urdf_file(urdf)
    model = build_inverse_model(whole, text, urdf.name)
    settings = configuration.simulated_robot
    truth = dict(zip(model.base.names, (float(v) for v in model.given), strict=True))
    place = f"{configuration.source or 'configuration'}: simulated_robot.parameters: "
    truth = EffectsFile(base_parameters=settings.parameters, place=place).changed(truth)
    beyond = EffectsFile() if extended is None else read_effects(Path(extended))
    truth = beyond.changed(truth)
    contributions_of(beyond.effects, model.robot.joints)  # refuses
    law = control_law(configuration.controller, len(model.robot.joints))
    if settings.delay is not None:
        law = replace(law, delay=settings.delay)
    return SimulatedRobot(
        robot=model.robot,
        truth=truth,
        parameters=model.dynamic_parameters(np.array(list(truth.values()))),
        law=law,
        configuration=configuration,
        description=text,
        effects=beyond.effects,
    )


TRUTH = ".truth.json"


@dataclass(frozen=True)
class SimulatedBag:
    """One simulated bag that was written."""

    path: Path
    seed: int
    samples: int
    rate: float  # Hz
    duration: float  # s
    joint_types: tuple[str, ...]  # ``revolute`` or ``prismatic``
    peak_torque: FloatArray  # (n_joints,) N m (N): largest recorded effort, on the joint side
    # (n_joints,) rad (m): largest distance between reference and true position
    peak_error: FloatArray

    def to_document(self) -> dict[str, object]:
        """Return the fields as plain values for JSON."""
        peaks = {"peak_torque": self.peak_torque.tolist(), "peak_error": self.peak_error.tolist()}
        plain = ("seed", "samples", "rate", "duration")
        return {"path": str(self.path)} | {name: getattr(self, name) for name in plain} | peaks


def simulate(
    configuration: Configuration,
    out: FilePath,
    trajectory: Trajectory,
    *,
    seeds: Sequence[int] = (1,),
    effects: FilePath | None = None,
    force: bool = False,
    progress: Progress | None = None,
) -> tuple[list[SimulatedBag], Path]:
    """Simulate a robot and write a bag for each seed, with the true base parameters.

    Topics: the joint states and the reference of the configuration (``/joint_reference`` where it
    names none), and ``/robot_description`` with the URDF of the nominal model.

    - `configuration`: with a URDF and a control law; `simulated_robot` is how the robot differs
    - `out`: the bag; with several seeds ``-SEED`` is put before its suffix
    - `trajectory`: references; the robot starts on its first sample
    - `effects`: a diagnosis (`gap.json`): the robot is its extended model, with its causes
    - `force`: replace files that this program did not write

    Returns the bags, and the JSON file ``{name: value}`` of the true base parameters, with the key
    ``format``, and with effects also ``{"effects": […]}``.

    Raises UsageError: the configuration cannot be simulated, or a file cannot be written.
    DataError: the closed loop diverged.
    """
    if len(set(seeds)) != len(seeds):
        raise UsageError("--seed: a seed is given twice")
    out = files.as_file(out)
    truth, ends = out.with_name(out.stem + TRUTH), [f"-{seed}" for seed in seeds]
    paths = [out.with_name(f"{out.stem}{end}{out.suffix}") for end in ends]
    paths = paths if len(seeds) > 1 else [out]
    files.require_file_place([*paths, truth], force=force)
    robot = simulated_robot(configuration, effects)
    content: dict[str, object] = {"format": files.TRUTH_FORMAT, **robot.truth}
    if effects is not None:
        keys = ("effect", "joint", "other_joint", "parameters")
        content["effects"] = [{key: getattr(one, key) for key in keys} for one in robot.effects]
    bags = []
    # All of them or none, also where one of many loops diverges.
    with (
        files.refused_if_unwritable(out),
        Stopwatch(progress) as watch,
        files.complete_files([*paths, truth]) as temporary,
    ):
        for count, (seed, path) in enumerate(zip(seeds, paths, strict=True)):
            watch.stage(f"simulating seed {seed}", count / len(seeds))
            record = robot.record(trajectory, seed)
            watch.stage(f"writing {path.name}", (count + 0.7) / len(seeds))
            with temporary[path].open("wb") as stream:
                write_messages(stream, recorded_topics(robot, record), robot.description)
            reference = record.position_reference
            true = record.truth.position[:: record.control_ratio][: len(reference)]
            bags.append(
                SimulatedBag(
                    path=path,
                    seed=seed,
                    samples=len(record.time),
                    rate=record.rate,
                    duration=(len(record.time) - 1) / record.rate,
                    joint_types=robot.robot.joint_types,
                    peak_torque=np.abs(record.effort).max(axis=0),
                    peak_error=np.abs(true - reference).max(axis=0),
                )
            )
        temporary[truth].write_text(json_text(content), encoding="utf-8")
    return bags, truth


def recorded_topics(robot: SimulatedRobot, record: SimulatedRecording) -> list[JointTopic]:
    """Return the messages as recorded, motor side: with transmission, offsets and effort scale."""
    section, signals = robot.configuration.robot, robot.configuration.signals
    joints = section.joints
    to_motor = np.array(section.motor_to_joint or np.eye(len(joints)))
    to_torque = np.array(section.motor_to_joint_torque or to_motor.T)
    offset = np.array(section.position_offset or [0.0] * len(joints))
    scale = np.array(signals.effort_scale or [1.0] * len(joints))
    effort = record.effort @ np.linalg.inv(to_torque * scale).T
    velocity = record.velocity_reference
    states = topic_of(signals.joint_states)
    reference = topic_of(signals.reference or "joint_reference")
    efforts = topic_of(signals.effort_topic or "")
    if reference in (states, efforts):
        raise UsageError(
            f"signals.reference is {reference}, which is measured too: a simulated recording needs "
            "two topics"
        )
    measured = (record.position - offset) @ to_motor.T
    wanted = (record.position_reference - offset) @ to_motor.T
    speed = None if velocity is None else velocity @ to_motor.T
    of_states = effort if efforts == states else None
    topics = [
        JointTopic(states, joints, record.time, measured, effort=of_states),
        JointTopic(reference, joints, np.arange(len(wanted)) / record.rate, wanted, speed),
    ]
    if efforts not in ("", states):
        topics.append(JointTopic(efforts, joints, record.time, effort=effort))
    return topics
