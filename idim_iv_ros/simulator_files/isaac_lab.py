"""Actuators of a robot for Isaac Lab, as a Python file that a user edits.

Fields as documented for Isaac Lab 2.3 and 3.0 (`ActuatorBaseCfg`, `DelayedPDActuatorCfg`): since
Isaac Sim 5 `friction` and `dynamic_friction` are efforts, `viscous_friction` a coefficient.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from idim_iv_ros.effects.registry import part_of
from idim_iv_ros.model import RobotModel
from idim_iv_ros.simulation import SimulatedEffect
from idim_iv_ros.simulator_files.robot import DriveLaw, ExportedRobot, JointValues
from idim_iv_ros.types import FloatArray

_FILE = '''"""{robot} for Isaac Lab, from {origin}.

Written from the documented fields of Isaac Lab 2.3 and 3.0, and not run there.
What these fields cannot express:
{inexpressible}
"""

from pathlib import Path

import isaaclab.sim as sim_utils
from isaaclab.actuators import {kind}
from isaaclab.assets import ArticulationCfg

PHYSICS_DT = {period!r}  # s, SimulationCfg.dt; delays below count such steps

ROBOT_CFG = ArticulationCfg(
    spawn=sim_utils.UrdfFileCfg(
        asset_path=str(Path(__file__).parent / "{urdf}"),
        fix_base=True,
        # The actuators below have the gains and the friction, not the importer's drives.
        joint_drive=sim_utils.UrdfConverterCfg.JointDriveCfg(
            gains=sim_utils.UrdfConverterCfg.JointDriveCfg.PDGainsCfg(
                stiffness=0.0, damping=0.0
            ),
        ),
    ),
    actuators={{
{actuators}
    }},
)
'''
_UNKNOWN_LAW = ["stiffness=0.0,  # the control law is not known: send efforts", "damping=0.0,"]


def isaac_lab_text(
    exported: ExportedRobot, urdf_name: str, effects: Sequence[SimulatedEffect]
) -> str:
    """Return the file, for the exported URDF of that name beside it.

    Effects that no field expresses are listed in a comment.
    """
    robot, values, law = exported.robot, exported.drives, exported.law
    delayed = bool(law.configured and any(law.delay))
    kind = "DelayedPDActuatorCfg" if delayed else "IdealPDActuatorCfg"
    said = _inexpressible(robot, values, law, effects) or ["nothing that was found"]
    # A delay is that of a group: one for each length.
    steps = [round(float(delay) / law.period) if delayed else 0 for delay in law.delay]
    lines = []
    for number in sorted(set(steps)):
        joints = [joint for joint, step in enumerate(steps) if step == number]
        name = "joints" if len(set(steps)) == 1 else f"delayed_{number}"
        fields = _fields(robot.joints, joints, values, law)
        if delayed:
            fields += [f"min_delay={number},", f"max_delay={number},"]
        lines += [f'        "{name}": {kind}(', *(f"            {line}" for line in fields)]
        lines.append("        ),")
    return _FILE.format(
        robot=robot.name,
        origin=exported.origin,
        inexpressible="\n".join(f"- {text}" for text in said),
        kind=kind,
        period=law.period,
        urdf=urdf_name,
        actuators="\n".join(lines),
    )


def _fields(
    names: Sequence[str], joints: Sequence[int], values: JointValues, law: DriveLaw
) -> list[str]:
    """Lines of the fields of one group of joints."""

    def field(name: str, numbers: FloatArray, unit: str) -> list[str]:
        listed: Mapping[str, float] = {
            names[joint]: float(numbers[joint]) for joint in joints if np.isfinite(numbers[joint])
        }
        entries = [f'    "{joint}": {value!r},' for joint, value in listed.items()]
        return [f"{name}={{  # {unit}", *entries, "},"] if listed else []

    return [
        f"joint_names_expr={[names[joint] for joint in joints]!r},",
        *([] if law.configured else _UNKNOWN_LAW),
        *(field("stiffness", law.kp, "N m/rad") if law.configured else ()),
        *(field("damping", law.kd, "N m s/rad") if law.configured else ()),
        *field("armature", values.armature, "kg m2"),
        *field("friction", values.friction, "N m: static, an effort"),
        *field(
            "dynamic_friction",
            values.friction,
            "N m: Coulomb; static friction beyond it is unknown",
        ),
        *field("viscous_friction", values.damping, "N m s/rad"),
        *field("effort_limit", law.limit, "N m"),
    ]


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
