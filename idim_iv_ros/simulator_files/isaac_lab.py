"""Actuators of a robot for Isaac Lab, as a Python file that a user edits.

Fields as documented for Isaac Lab 2.3 and 3.0 (`ActuatorBaseCfg`, `DelayedPDActuatorCfg`): since
Isaac Sim 5 `friction` and `dynamic_friction` are efforts, `viscous_friction` a coefficient.
"""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.effects.registry import part_of
from idim_iv_ros.model import RobotModel
from idim_iv_ros.simulation import SimulatedEffect
from idim_iv_ros.simulator_files.file_text import file_text
from idim_iv_ros.simulator_files.robot import DriveLaw, ExportedRobot, JointValues


def isaac_lab_text(
    exported: ExportedRobot, urdf_name: str, effects: Sequence[SimulatedEffect]
) -> str:
    """Return the file, for the exported URDF of that name beside it.

    Effects that no field expresses are listed in a comment.
    """
    robot, values, law = exported.robot, exported.drives, exported.law
    delayed = bool(law.configured and any(law.delay))
    # A delay is that of a group: one for each length.
    steps = [round(float(delay) / law.period) if delayed else 0 for delay in law.delay]
    groups = [
        {
            "name": "joints" if len(set(steps)) == 1 else f"delayed_{delay}",
            "delay": delay,
            "joints": [
                name for name, step in zip(robot.joints, steps, strict=True) if step == delay
            ],
            "fields": _fields(robot.joints, [step == delay for step in steps], values, law),
        }
        for delay in sorted(set(steps))
    ]
    return file_text(
        "isaac_lab.py",
        robot=robot.name,
        origin=exported.origin,
        inexpressible=_inexpressible(robot, values, law, effects) or ["nothing that was found"],
        kind="DelayedPDActuatorCfg" if delayed else "IdealPDActuatorCfg",
        period=law.period,
        urdf=urdf_name,
        configured=law.configured,
        delayed=delayed,
        groups=groups,
    )


def _fields(
    names: Sequence[str], chosen: Sequence[bool], values: JointValues, law: DriveLaw
) -> list[tuple[str, str, dict[str, float]]]:
    """Fields of one group of joints with finite numbers: name, unit, and numbers by joint."""
    fields = [
        *([("stiffness", law.kp, "N m/rad")] if law.configured else []),
        *([("damping", law.kd, "N m s/rad")] if law.configured else []),
        ("armature", values.armature, "kg m2"),
        ("friction", values.friction, "N m: static, an effort"),
        ("dynamic_friction", values.friction, "N m: Coulomb; static friction beyond it is unknown"),
        ("viscous_friction", values.damping, "N m s/rad"),
        ("effort_limit", law.limit, "N m"),
    ]
    listed = []
    for field, numbers, unit in fields:
        finite = np.isfinite(numbers) & chosen
        by_joint = {name: float(numbers[k]) for k, name in enumerate(names) if finite[k]}
        if by_joint:
            listed.append((field, unit, by_joint))
    return listed


def _inexpressible(
    robot: RobotModel, values: JointValues, law: DriveLaw, effects: Sequence[SimulatedEffect]
) -> list[str]:
    """What no field of an actuator holds, a line each."""
    joints = robot.joints
    said = [] if law.configured else [law.words]
    if any(law.ki):
        said.append("integral gains: write an actuator class")
    if law.configured and not law.velocity_reference:
        said.append("the kd term acts on the speed: leave the velocity target at zero")
    said += [f"law: {term}" for term in law.beyond]
    if any(law.delay):
        said.append(
            "the delay is that of the targets; the robot's is that of the torque, feedback included"
        )
    if any(values.offset):
        offsets = zip(joints, values.offset, strict=True)
        listed = ", ".join(f"{name} {offset:.6g}" for name, offset in offsets)
        said.append(f"constant torques that the motors must overcome, N m: {listed}")
    said += [
        f"transmission between {joints[coupling.first]} and {joints[coupling.second]}: common "
        f"inertia {coupling.inertia:.6g}, damping {coupling.damping:.6g}, friction "
        f"{coupling.friction:.6g}"
        for coupling in values.couplings
    ]
    for effect in effects:
        part = part_of(effect.effect)
        if part not in ("delay", "offset") and (part != "gains" or law.beyond):
            numbers = ", ".join(f"{name} {value:.6g}" for name, value in effect.parameters.items())
            where = f" at {effect.joint}" if effect.joint else ""
            said.append(f"{effect.effect}{where}: {numbers}; write an actuator class")
    return said
