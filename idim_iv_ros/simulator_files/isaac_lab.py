"""Actuators of a robot for Isaac Lab, as a Python file that a user edits.

Fields as documented for Isaac Lab 2.3 and 3.0 (`ActuatorBaseCfg`, `DelayedPDActuatorCfg`): since
Isaac Sim 5 `friction` and `dynamic_friction` are efforts, `viscous_friction` a coefficient.
"""

import math
from collections.abc import Sequence

from idim_iv_ros.effects.registry import part_of
from idim_iv_ros.model import RobotModel
from idim_iv_ros.simulation import SimulatedEffect
from idim_iv_ros.simulator_files.law import DriveLaw
from idim_iv_ros.simulator_files.mjcf import JointValues
from idim_iv_ros.types import FloatArray


def isaac_lab_text(
    robot: RobotModel,
    urdf_name: str,
    values: JointValues,
    law: DriveLaw,
    effects: Sequence[SimulatedEffect],
    origin: str,
) -> str:
    """Return the file.

    Parameters
    ----------
    urdf_name
        Of the exported URDF beside it.
    effects
        Of the robot; those that no field expresses are listed in a comment.
    origin
        What the numbers come from, for the first line.
    """
    delayed = bool(law.known and any(law.delay))
    kind = "DelayedPDActuatorCfg" if delayed else "IdealPDActuatorCfg"
    explained = _inexpressible(robot, values, law, effects)
    fields = [
        ("stiffness", law.kp, "N m/rad"),
        ("damping", law.kd, "N m s/rad"),
        ("armature", values.armature, "kg m2"),
        ("friction", values.friction, "N m: static, an effort"),
        ("dynamic_friction", values.friction, "N m: Coulomb; static friction beyond it is unknown"),
        ("viscous_friction", values.damping, "N m s/rad"),
    ]
    if not law.known:
        fields = fields[2:]
    lines = [
        f'"""{robot.name} for Isaac Lab, from {origin}.',
        "",
        "Written from the documented fields of Isaac Lab 2.3 and 3.0, and not run there.",
        "What these fields cannot express:",
        *(f"- {text}" for text in explained or ["nothing that was found"]),
        '"""',
        "",
        "from pathlib import Path",
        "",
        "import isaaclab.sim as sim_utils",
        f"from isaaclab.actuators import {kind}",
        "from isaaclab.assets import ArticulationCfg",
        "",
        f"PHYSICS_DT = {law.period!r}  # s, SimulationCfg.dt; delays below count such steps",
        "",
        "ROBOT_CFG = ArticulationCfg(",
        "    spawn=sim_utils.UrdfFileCfg(",
        f'        asset_path=str(Path(__file__).parent / "{urdf_name}"),',
        "        fix_base=True,",
        "        # The actuators below have the gains and the friction, not the importer's drives.",
        "        joint_drive=sim_utils.UrdfConverterCfg.JointDriveCfg(",
        "            gains=sim_utils.UrdfConverterCfg.JointDriveCfg.PDGainsCfg(",
        "                stiffness=0.0, damping=0.0",
        "            ),",
        "        ),",
        "    ),",
        "    actuators={",
        *_actuators(robot, law, fields, kind, delayed),
        "    },",
        ")",
    ]
    return "\n".join(lines) + "\n"


def _actuators(
    robot: RobotModel,
    law: DriveLaw,
    fields: Sequence[tuple[str, FloatArray, str]],
    kind: str,
    delayed: bool,
) -> list[str]:
    """One group, or one for each length of the delay: a delay is a group's."""
    steps = [round(float(delay) / law.period) if delayed else 0 for delay in law.delay]
    lines = []
    for number in sorted(set(steps)):
        own = [joint for joint, step in enumerate(steps) if step == number]
        name = "joints" if len(set(steps)) == 1 else f"delayed_{number}"
        lines += [
            f'        "{name}": {kind}(',
            f"            joint_names_expr={[robot.joints[joint] for joint in own]!r},",
        ]
        if not law.known:
            lines += [
                "            stiffness=0.0,  # the control law is not known: send efforts",
                "            damping=0.0,",
            ]
        for field, numbers, unit in fields:
            listed = {robot.joints[joint]: float(numbers[joint]) for joint in own}
            lines += [f"            {field}={{  # {unit}", *_entries(listed), "            },"]
        limits = {
            robot.joints[joint]: float(law.limit[joint])
            for joint in own
            if math.isfinite(law.limit[joint])
        }
        if limits:
            lines += ["            effort_limit={  # N m", *_entries(limits), "            },"]
        if delayed:
            lines += [f"            min_delay={number},", f"            max_delay={number},"]
        lines.append("        ),")
    return lines


def _entries(numbers: dict[str, float]) -> list[str]:
    return [f'                "{name}": {value!r},' for name, value in numbers.items()]


def _inexpressible(
    robot: RobotModel, values: JointValues, law: DriveLaw, effects: Sequence[SimulatedEffect]
) -> list[str]:
    found = []
    if not law.known:
        found.append(law.words)
    if any(law.ki):
        found.append("integral gains: write an actuator class")
    if law.known and not law.velocity_reference:
        found.append("the kd term acts on the speed: leave the velocity target at zero")
    found += [f"law: {joint}" for joint in law.beyond]
    if any(law.delay):
        found.append(
            "the delay is that of the targets; the robot's is that of the torque, feedback included"
        )
    if any(values.offset):
        offsets = ", ".join(
            f"{name} {offset:.6g}" for name, offset in zip(robot.joints, values.offset, strict=True)
        )
        found.append(f"constant torques that the motors must overcome, N m: {offsets}")
    found += [
        f"transmission between {robot.joints[coupling.first]} and "
        f"{robot.joints[coupling.second]}: common inertia {coupling.inertia:.6g}, damping "
        f"{coupling.damping:.6g}, friction {coupling.friction:.6g}"
        for coupling in values.couplings
    ]
    for effect in effects:
        part = part_of(effect.effect)
        if part in ("delay", "offset") or (part == "gains" and not law.beyond):
            continue
        numbers = ", ".join(f"{name} {value:.6g}" for name, value in effect.parameters.items())
        where = f" at {effect.joint}" if effect.joint else ""
        found.append(f"{effect.effect}{where}: {numbers}; write an actuator class")
    return found
