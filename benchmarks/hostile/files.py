"""What a user would have of a cell: bags as drivers write them, a configuration, a URDF."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from ruamel.yaml import YAML

from benchmarks.hostile.nuisances import Nuisances
from benchmarks.hostile.plants import Run
from benchmarks.hostile.session import HostileSession
from benchmarks.withheld_effects.sensors import frozen
from idim_iv_ros.recording.writing.write import JointTopic, write_bag

FloatArray = NDArray[np.float64]
PAUSE = 5.0  # s between two recordings
BEGIN = 0.01  # s, where logs start that "start at zero": no stamp is negative
MOST_JITTER = 0.4  # of an interval


def write_files(folder: Path, made: HostileSession, seed: int) -> None:
    """Write configuration, URDF and bags; their names do not follow the order of time."""
    rng = np.random.default_rng([seed, 1])
    urdf = made.given.urdf.read_text(encoding="utf-8")
    if not made.nuisances.knows_friction:
        urdf = re.sub("<dynamics [^>]*/>", "", urdf)
    (folder / made.given.urdf.name).write_text(urdf, encoding="utf-8")
    with (folder / "robot.yaml").open("w", encoding="utf-8") as file:
        YAML(typ="safe").dump(configuration(made), file)
    # Logs often start at zero each; then their order in time is not known.
    at_zero = rng.random() < 0.4
    start = float(rng.uniform(10.0, 1000.0))
    for number, run in zip(rng.permutation(len(made.runs)), made.runs, strict=True):
        topics = list(_topics(made, run, BEGIN if at_zero else start, rng))
        write_bag(folder / f"recording_{number + 1}.mcap", topics)
        start += len(run.recorded.position) * made.nuisances.period + PAUSE


def configuration(made: HostileSession) -> dict[str, Any]:
    """What the user knows of the robot."""
    nuisances, robot = made.nuisances, made.given
    law: dict[str, Any] = {
        "type": "pd",
        "kp": (robot.controller.kp * nuisances.softer**2).tolist(),
        "kd": (robot.controller.kd * nuisances.softer).tolist(),
        "torque_limit": robot.controller.limit.tolist(),
    }
    given: dict[str, Any] = {
        "robot": {"urdf": robot.urdf.name, "joints": list(robot.joints)},
        "simulator": {"armature": robot.armature.tolist()},
        "controller": law,
    }
    law["period"] = nuisances.period
    if not nuisances.knows_period:
        del law["period"]
    if not nuisances.knows_controller:
        given["controller"] = {"type": "unknown"}
    if not nuisances.knows_armature:
        del given["simulator"]
    given["signals"] = {"joint_states": "/joint_states"}
    if nuisances.has_reference:
        given["signals"]["reference"] = "/joint_reference"
    if nuisances.separate_topic:
        given["signals"]["effort"] = "/joint_efforts"
    if nuisances.gain is not None:
        given["signals"]["effort_scale"] = list(nuisances.gain)
    return given


def _topics(
    made: HostileSession, run: Run, start: float, rng: np.random.Generator
) -> Iterator[JointTopic]:
    nuisances, joints = made.nuisances, made.given.joints
    every = slice(None, None, nuisances.record_every)
    recorded = run.recorded
    interval = nuisances.period * nuisances.record_every
    time = np.arange(len(recorded.position[every])) * interval
    effort = _effort(made, run, rng)[every]
    stamps = start + time + _jitter(nuisances, time, interval, rng)
    shared = not nuisances.separate_topic
    yield JointTopic(
        "/joint_states",
        joints,
        stamps,
        recorded.position[every],
        recorded.speed[every] if nuisances.publishes_velocity else None,
        effort if shared else None,
    )
    if not shared:
        kept = slice(None, None, nuisances.effort_every)
        late = nuisances.effort_offset + _jitter(nuisances, time, interval, rng)
        # Nothing is stamped before the recorder started.
        after_start = start + time[kept] + late[kept] >= 0.0
        yield JointTopic(
            "/joint_efforts",
            joints,
            (start + time + late)[kept][after_start],
            None,
            None,
            effort[kept][after_start],
        )
    if nuisances.has_reference:
        yield JointTopic(
            "/joint_reference",
            joints,
            stamps,
            run.position_reference[every],
            run.velocity_reference[every],
        )


def _jitter(
    nuisances: Nuisances, time: FloatArray, interval: float, rng: np.random.Generator
) -> FloatArray:
    """Errors of the stamps (n,) s; their order stays."""
    most = MOST_JITTER * interval
    return np.clip(rng.normal(size=len(time)) * nuisances.jitter, -most, most)


def _effort(made: HostileSession, run: Run, rng: np.random.Generator) -> FloatArray:
    """What the driver calls effort at each control period, (n_periods, n_joints) N m or A."""
    nuisances, recorded = made.nuisances, run.recorded
    measured = nuisances.effort == "measured"
    torque = recorded.applied if measured else recorded.command
    torque = torque + made.sensors.torque * rng.normal(size=torque.shape)
    torque = frozen(torque, made.sensors.dropout, nuisances.period, rng)
    if nuisances.gain is None:
        return torque
    waves = np.sin(np.array(nuisances.ripple_orders) * recorded.position)
    return np.asarray(torque / (np.array(nuisances.gain) * (1.0 + nuisances.ripple * waves)))
