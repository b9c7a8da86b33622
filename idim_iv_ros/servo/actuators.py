"""Servos as simulators hold them: a MuJoCo model, Isaac Lab actuators, and a configuration."""

import io
import math
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from ruamel.yaml import YAML

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.files import SERVO, write_together
from idim_iv_ros.identification.prepare import description_text, read_configured
from idim_iv_ros.model.mjcf import load_mujoco, set_first
from idim_iv_ros.servo.result import ServoJoint, ServoResult

MODEL, ISAAC_LAB, CONFIGURATION = "servo.xml", "servo_isaac_lab.py", "servo.yaml"
_STEP = 0.002  # s, time step of the model where it gives none that is finer
_PERIOD = 0.0005  # s, of the loop in simulations: servos compute theirs at 1 to 2 kHz
_ISAAC_STEP = 0.005  # s, in which Isaac Lab counts delays
_ISAAC_LAB = '''"""Servos of {robot}, identified without torques from {recordings}.

Written from the documented fields of Isaac Lab 2.3, and not run there.
"""

from isaaclab.actuators import DelayedPDActuatorCfg

PHYSICS_DT = {step!r}  # s; delays count such steps
ACTUATORS = {{
{actuators}
}}
'''
_STIFF = 2.0  # steps: shortest time constant of dry friction that MuJoCo integrates


def rounded(joint: ServoJoint, name: str, otherwise: float = 0.0) -> float:
    """Value of a number to a tenth of its interval; `otherwise` where it is not shown."""
    number = joint.number(name)
    if number is None or not number.shown or not math.isfinite(number.value):
        return otherwise
    wide = number.high - number.low
    if not math.isfinite(wide) or wide <= 0.0:
        return float(number.value)
    return round(float(number.value), 1 - math.floor(math.log10(wide)))


def servo_mjcf(result: ServoResult, configuration: Configuration, urdf: str) -> str:
    """Return the user's model with position actuators, armature and friction of its servos.

    - `configuration`: of an MJCF everything else stays; of a URDF the shapes are left out
    - `urdf`: text of the description, where it is no MJCF

    Raises DataError: no joint has absolute numbers; UsageError: MuJoCo is not installed.
    """
    absolute = [joint for joint in result.joints if joint.absolute]
    if not absolute:
        raise DataError("no servo's stiffness is known in N m/rad: there is no model to write")
    mujoco = load_mujoco("a model with servos")
    source = configuration.robot.mjcf
    if source is not None:
        spec = mujoco.MjSpec.from_file(str(source))
    else:
        root = ElementTree.fromstring(urdf)
        for link in root.iter("link"):  # meshes need not be there
            for shape in (*link.findall("visual"), *link.findall("collision")):
                link.remove(shape)
        settings = {"fusestatic": "false", "discardvisual": "true", "balanceinertia": "true"}
        ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler", settings)
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
        spec.option.gravity = configuration.robot.gravity
    spec.option.timestep = min(spec.option.timestep, _STEP)
    step = spec.option.timestep
    for actuator in list(spec.actuators):
        if actuator.target in {joint.joint for joint in absolute}:
            spec.delete(actuator)
    for servo in absolute:
        joint = spec.joint(servo.joint)
        joint.armature = rounded(servo, "armature")
        # The recording says what the torque is limited to, not the data sheet.
        joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
        set_first(joint, "damping", rounded(servo, "damping"))
        joint.frictionloss = rounded(servo, "dry friction")
        joint.solref_friction = [_STIFF * step, 1.0]
        stiffness = rounded(servo, "stiffness")
        limit, delay = rounded(servo, "torque limit", math.inf), rounded(servo, "delay")
        position = spec.add_actuator(name=servo.joint, target=servo.joint)
        position.trntype = mujoco.mjtTrn.mjTRN_JOINT
        position.gaintype = mujoco.mjtGain.mjGAIN_FIXED
        position.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        # Whatever the defaults of a user's file make of an actuator.
        position.gainprm[:] = position.biasprm[:] = 0.0
        position.gainprm[0], position.biasprm[1] = stiffness, -stiffness
        if math.isfinite(limit):
            position.forcelimited, position.forcerange = True, [-limit, limit]
        if delay > 0.0 and hasattr(position, "delay"):
            position.delay, position.nsample = delay, math.ceil(delay / step) + 1
    spec.compile()
    return str(spec.to_xml())


def servo_isaac_lab(result: ServoResult) -> str:
    """Return a Python text with one `DelayedPDActuatorCfg` for each servo of absolute numbers."""
    actuators = []
    for servo in result.joints:
        if not servo.absolute:
            actuators.append(f"    # {servo.joint}: its stiffness is not known in N m/rad")
            continue
        late = round(rounded(servo, "delay") / _ISAAC_STEP)
        limit = rounded(servo, "torque limit", math.inf)
        fields = [
            f'joint_names_expr=["{servo.joint}"],',
            f"stiffness={rounded(servo, 'stiffness')},  # N m/rad",
            "damping=0.0,  # of the loop; it is part of viscous_friction",
            f"armature={rounded(servo, 'armature')},  # kg m2",
            f"friction={rounded(servo, 'dry friction')},  # N m",
            f"dynamic_friction={rounded(servo, 'dry friction')},  # N m",
            f"viscous_friction={rounded(servo, 'damping')},  # N m s/rad",
            *([f"effort_limit={limit},  # N m"] if math.isfinite(limit) else []),
            *(f"min_delay={late},", f"max_delay={late},"),
        ]
        actuators += [f'    "{servo.joint}": DelayedPDActuatorCfg(']
        actuators += [*(f"        {field}" for field in fields), "    ),"]
    return _ISAAC_LAB.format(
        robot=result.robot,
        recordings=", ".join(result.recordings),
        step=_ISAAC_STEP,
        actuators="\n".join(actuators),
    )


def servo_configuration(
    result: ServoResult, configuration: Configuration
) -> dict[str, dict[str, object]]:
    """Keys by section of a configuration in which the servos' law stands for the efforts.

    With it `identify` and `diagnose` take K·sat(command − position) as the torque. The nominal
    model is the one that `servo_mjcf` writes.
    """
    joints = list(result.joints)
    limits = [rounded(joint, "torque limit", math.inf) for joint in joints]
    limited = {"torque_limit": limits} if all(map(math.isfinite, limits)) else {}
    return {
        "robot": {
            "mjcf": MODEL,
            "joints": [joint.joint for joint in joints],
            "gravity": list(configuration.robot.gravity),
        },
        "controller": {
            "type": "pd",
            "kp": [rounded(joint, "stiffness") for joint in joints],
            "kd": [0.0] * len(joints),
            "period": _PERIOD,
            **limited,
        },
        "signals": {
            "joint_states": configuration.signals.joint_states,
            "effort": "none",
            "reference": configuration.signals.reference,
            "reference_delay": float(np.mean([rounded(joint, "delay") for joint in joints])),
        },
    }


def require_servo_files(out: Path, *, force: bool) -> None:
    """Refuse with a UsageError to replace files that no earlier identification of servos wrote."""
    for file in (out / MODEL, out / ISAAC_LAB, out / CONFIGURATION):
        if file.exists() and not force and not (out / SERVO).is_file():
            raise UsageError(
                f"{file}: exists, and is not of an earlier `idim-iv servo`; give another --out, "
                "or --force to replace it"
            )


def write_servo_files(
    result: ServoResult, configuration: Configuration, bags: Sequence[Path], out: Path
) -> list[Path]:
    """Write the model, the actuators and the configuration into a folder; return their paths.

    The configuration needs every joint in N m, and is left out otherwise.
    """
    description, _ = description_text(configuration, read_configured(bags[:1], configuration))
    texts = {
        out / MODEL: servo_mjcf(result, configuration, description),
        out / ISAAC_LAB: servo_isaac_lab(result),
    }
    if all(joint.absolute for joint in result.joints):
        stream = io.StringIO()
        YAML().dump(servo_configuration(result, configuration), stream)
        texts[out / CONFIGURATION] = stream.getvalue()
    write_together(texts)
    return list(texts)
