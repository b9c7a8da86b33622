"""Bags of a simulated robot: what a recorder on it would have written."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.encoding import json_text
from idim_iv_ros.errors import UsageError
from idim_iv_ros.excitation import Trajectory
from idim_iv_ros.files import (
    SIMULATION_FORMAT,
    TRUTH_FORMAT,
    FilePath,
    as_file,
    complete_files,
    require_file_place,
)
from idim_iv_ros.model import read_urdf_file
from idim_iv_ros.progress import Progress, Stopwatch
from idim_iv_ros.recording import JointTopic
from idim_iv_ros.recording.writing.write import write_messages
from idim_iv_ros.signal_source import topic_of
from idim_iv_ros.simulation import SimulatedRecording
from idim_iv_ros.simulators.robot import SimulatedRobot, simulated_robot
from idim_iv_ros.types import FloatArray

TRUTH = ".truth.json"


@dataclass(frozen=True)
class SimulatedBag:
    """One bag that was written."""

    path: Path
    seed: int
    samples: int
    # rate, duration: Hz, s
    rate: float
    duration: float
    joint_types: tuple[str, ...]  # ``revolute`` or ``prismatic``
    peak_torque: FloatArray  # (n_joints,) N m (N): largest recorded effort, on the joint side
    # (n_joints,) rad (m): largest distance between reference and true position
    peak_error: FloatArray


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
    """Write one bag for each seed, and the true base parameters beside them.

    Topics: the joint states and the reference of the configuration (``/joint_reference`` where
    it names none), and ``/robot_description`` with the URDF of the nominal model.

    - `configuration`: with a URDF and a control law; `simulated_robot` says how the
      robot differs from both
    - `out`: the bag; with several seeds ``-SEED`` is put before its suffix
    - `trajectory`: references; the robot starts on its first sample
    - `effects`: a diagnosis (`gap.json`): the robot is its extended model, with its causes
    - `force`: replace files that this program did not write

    Returns
    -------
    list of SimulatedBag, Path
        The bags, and the JSON file ``{name: value}`` of the true base parameters, with the key
        ``format``, and with effects also ``{"effects": […]}``.

    Raises
    ------
    UsageError
        The configuration cannot be simulated, or a file cannot be written.
    DataError
        The closed loop diverged.
    """
    urdf = configuration.robot.description
    if urdf is None:
        raise UsageError(f"{configuration.source}: robot.urdf or robot.mjcf is needed to simulate")
    if len(set(seeds)) != len(seeds):
        raise UsageError("--seed: a seed is given twice")
    require_simulation_place(out, seeds, force=force)
    bag_paths, truth = _paths(Path(out), seeds)
    text = read_urdf_file(urdf)
    extended = None if effects is None else Path(effects)
    robot = simulated_robot(configuration, text, urdf.name, extended)
    content: dict[str, object] = {"format": TRUTH_FORMAT, **robot.truth}
    if effects is not None:
        keys = ("effect", "joint", "other_joint", "parameters")
        content["effects"] = [
            {key: getattr(effect, key) for key in keys} for effect in robot.effects
        ]
    bags = []
    try:
        # All of them or none, also where one of many loops diverges.
        with (
            Stopwatch(progress) as watch,
            complete_files([*bag_paths.values(), truth]) as temporary,
        ):
            for count, seed in enumerate(seeds):
                watch.stage(f"simulating seed {seed}", count / len(seeds))
                record = robot.record(trajectory, seed)
                path = bag_paths[seed]
                watch.stage(f"writing {path.name}", (count + 0.7) / len(seeds))
                topics = recorded_topics(configuration, robot, record)
                with temporary[path].open("wb") as stream:
                    write_messages(stream, topics, text)
                bags.append(_summary(path, seed, record, robot.robot.joint_types))
            temporary[truth].write_text(json_text(content), encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{out}: cannot be written: {error.strerror or error}") from error
    return bags, truth


def simulation_document(bags: Sequence[SimulatedBag], truth: Path) -> dict[str, object]:
    """Plain values of the bags that were written, for programs."""
    return {
        "format": SIMULATION_FORMAT,
        "bags": [
            {name: getattr(bag, name) for name in ("seed", "samples", "rate", "duration")}
            | {"path": str(bag.path)}
            | {name: getattr(bag, name).tolist() for name in ("peak_torque", "peak_error")}
            for bag in bags
        ],
        "truth": str(truth),
    }


def require_simulation_place(out: FilePath, seeds: Sequence[int], *, force: bool = False) -> None:
    """Refuse, before long work, bags that could not be written; see `require_file_place`."""
    bags, truth = _paths(as_file(out), seeds)
    require_file_place([*bags.values(), truth], force=force)


def _paths(out: Path, seeds: Sequence[int]) -> tuple[dict[int, Path], Path]:
    """Return the bag of each seed, and the file of the true parameters."""
    bags = {seed: out.with_name(f"{out.stem}-{seed}{out.suffix}") for seed in seeds}
    return bags if len(seeds) > 1 else {seeds[0]: out}, out.with_name(out.stem + TRUTH)


def recorded_topics(
    configuration: Configuration, robot: SimulatedRobot, record: SimulatedRecording
) -> list[JointTopic]:
    """Messages on the recorder's side of transmission, offsets and effort scale."""
    section, signals = configuration.robot, configuration.signals
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
    topics = [
        JointTopic(
            states,
            joints,
            record.time,
            (record.position - offset) @ to_motor.T,
            effort=effort if efforts == states else None,
        ),
        JointTopic(
            reference,
            joints,
            np.arange(len(record.time)) / record.rate,
            (record.position_reference - offset) @ to_motor.T,
            None if velocity is None else velocity @ to_motor.T,
        ),
    ]
    if efforts not in ("", states):
        topics.append(JointTopic(efforts, joints, record.time, effort=effort))
    return topics


def _summary(
    path: Path, seed: int, record: SimulatedRecording, joint_types: tuple[str, ...]
) -> SimulatedBag:
    """Say what of a recording a user is told."""
    truth = record.truth.position[:: record.control_ratio][: len(record.position_reference)]
    return SimulatedBag(
        path=path,
        seed=seed,
        samples=len(record.time),
        rate=record.rate,
        duration=(len(record.time) - 1) / record.rate,
        joint_types=joint_types,
        peak_torque=np.abs(record.effort).max(axis=0),
        peak_error=np.abs(truth - record.position_reference).max(axis=0),
    )
