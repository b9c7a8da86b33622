"""Joints and tendons that some effects need in an MJCF: shafts and couplings.

Elasticity and backlash make two masses of a joint. The joint stays that of the motor, with its
armature, friction and actuators; a second one on the same body, ``NAME_shaft`` about the same axis,
is the position of the link less that of the motor. Friction between two joints is that of a
tendon ``A_B_coupling`` over both.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from idim_iv_ros.effects.contribution import CouplingTerm, ShaftPart
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import FilePath
from idim_iv_ros.model.mujoco_package import load_mujoco, mujoco_reads
from idim_iv_ros.simulation.affected_robot import JointContributions
from idim_iv_ros.simulation.effects import SimulatedEffect, joint_effects
from idim_iv_ros.simulators.effects_file import read_effects

SHAFT, COUPLING = "_shaft", "_coupling"


def model_with_effects(model: FilePath, effects: FilePath) -> Any:
    """Compile an MJCF with the parts that the effects of a file need.

    Without elasticity, backlash and joint coupling it is the model of the file as it is.

    Raises
    ------
    UsageError
        MuJoCo is not installed, a file cannot be read, an effect or joint is not known.
    """
    mujoco = load_mujoco("a model with effects")
    parts = read_effects(Path(effects)).effects
    with mujoco_reads(model):
        spec = mujoco.MjSpec.from_file(str(model))
        add_parts(spec, parts)
        compiled = spec.compile()
    return compiled


def add_parts(spec: Any, effects: Sequence[SimulatedEffect]) -> None:
    """Add shafts and couplings to a specification that is not compiled yet."""
    joints = [joint.name for joint in spec.joints if joint.name]
    ours = [effect for effect in effects if not effect.native]
    for one in joint_effects(ours, joints):
        parts = JointContributions(
            tuple(
                (one.joint, one.other_joint, contribution)
                for contribution in one.contributions(0.0)
            )
        )
        for joint, _ in parts.of(ShaftPart):
            _add_shaft(spec, joints[joint])
        for first, second, term in parts.couplings:
            _add_coupling(spec, joints[first], joints[second], term)


def _add_shaft(spec: Any, name: str) -> None:
    if spec.joint(name + SHAFT) is not None:
        return
    joint = spec.joint(name)
    if float(joint.armature) <= 0.0:
        raise UsageError(
            f"elasticity or backlash at {name} needs its drive inertia: the joint has no armature"
        )
    if len(joint.parent.joints) > 1:
        raise UsageError(f"elasticity or backlash at {name}: its body has several joints")
    shaft = joint.parent.add_joint(
        name=name + SHAFT, type=joint.type, pos=joint.pos, axis=joint.axis
    )
    for key in ("armature", "frictionloss", "damping", "stiffness"):  # not those of a default
        setattr(shaft, key, 0.0 * getattr(joint, key))


def _add_coupling(spec: Any, first: str, second: str, term: CouplingTerm) -> None:
    name = coupling_name(first, second)
    if spec.tendon(name) is not None:
        return
    tendon = spec.add_tendon(name=name)
    tendon.wrap_joint(first, 1.0)
    tendon.wrap_joint(second, float(term.direction))


def coupling_name(first: str, second: str) -> str:
    """Name of the tendon that couples two joints."""
    return f"{first}_{second}{COUPLING}"
