"""MuJoCo models of a replay: made from the nominal model, or read from a file."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from idim_iv_ros.effects.registry import BY_NAME
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import FilePath, read_text
from idim_iv_ros.model import DynamicParameters, InverseModel, RobotModel
from idim_iv_ros.model.mjcf import is_mjcf
from idim_iv_ros.model.mjcf_ties import native_elements
from idim_iv_ros.model.mujoco_package import mujoco_reads
from idim_iv_ros.simulation import SimulatedEffect
from idim_iv_ros.simulators.effects_file import constant_torques
from idim_iv_ros.simulators.mujoco import STIFFEST
from idim_iv_ros.simulators.mujoco_loop import LONGEST_STEP
from idim_iv_ros.simulators.mujoco_parts import (
    add_motors,
    add_parts,
    nearest_parameters,
    plant_spec,
    set_inertias,
)
from idim_iv_ros.simulators.replay_result import CORRECTED, NOMINAL, WITH_EFFECTS
from idim_iv_ros.types import FloatArray


@dataclass(frozen=True)
class StageModel:
    """Robot model of one stage of a replay."""

    name: str  # Of the stage
    words: str  # What the model is made of
    robot: RobotModel
    parameters: DynamicParameters | None  # None for a model that is read from `xml`
    xml: Path | None
    # Beyond the model: constant torques, which MuJoCo has no parameter for, are among them
    effects: tuple[SimulatedEffect, ...] = ()
    notes: tuple[str, ...] = ()

    def with_effects(self, effects: Sequence[SimulatedEffect]) -> "StageModel":
        """Return the model with effects, without those that elements of its file have already."""
        # Motors of a replay take the place of the file's actuators, and with them of their delay.
        # A model that is made here has no effect of its own.
        held = [bool(self.xml and e.native and BY_NAME[e.effect].element_of) for e in effects]
        ours = [replace(e, native=native) for e, native in zip(effects, held, strict=True)]
        words = f"{self.words}, with {', '.join(dict.fromkeys(e.effect for e in ours))}"
        return replace(self, name=WITH_EFFECTS, words=words, effects=(*self.effects, *ours))

    def compiled(self, mujoco: Any) -> Any:
        """Return the MuJoCo model, with a motor for each joint and the parts for effects."""
        if self.parameters is not None:
            spec = plant_spec(mujoco, self.robot, self.parameters)
        elif self.xml is not None:
            spec = _read_mjcf(mujoco, self.xml, self.robot.joints)
        with mujoco_reads(self.xml or self.robot.name):
            add_motors(mujoco, spec, self.robot.joints)
            add_parts(spec, self.effects)
            model = spec.compile()
        bits = mujoco.mjtDisableBit
        for bit in (bits.mjDSBL_CONTACT, bits.mjDSBL_LIMIT, bits.mjDSBL_AUTORESET):
            model.opt.disableflags |= bit
        if self.parameters is not None:
            set_inertias(mujoco, model, self.robot, self.parameters)
            model.dof_solref[:] = (2.0 * LONGEST_STEP, 1.0)
            model.dof_solimp[:] = STIFFEST
        return model


def plant_stage(mujoco: Any, model: InverseModel, values: FloatArray | None = None) -> StageModel:
    """Return a stage from the nominal model, or with other base parameters (b,)."""
    robot = model.robot
    parameters = robot.given if values is None else nearest_parameters(model, values)
    plant_spec(mujoco, robot, parameters)  # refuses what cannot be simulated
    effects = constant_torques(robot.joints, dict(enumerate(parameters.offset)))
    if values is None:
        return StageModel(NOMINAL, "the nominal model", robot, parameters, None, effects)
    return StageModel(
        CORRECTED, "the nominal model with found parameters", robot, parameters, None, effects
    )


def nominal_stage(mujoco: Any, model: InverseModel, mjcf: Path | None) -> StageModel:
    """Return the stage of the nominal model: the user's MJCF, if its joints are the robot's."""
    robot = model.robot
    if mjcf is not None:
        with mujoco_reads(mjcf):
            of_file = {joint.name for joint in mujoco.MjSpec.from_file(str(mjcf)).joints}
        if of_file == set(robot.joints):
            words = f"{mjcf.name} as given"
            return replace(xml_stage(mujoco, robot, mjcf, {}), name=NOMINAL, words=words)
    return plant_stage(mujoco, model)


def xml_stage(
    mujoco: Any, robot: RobotModel, path: Path, parameters: Mapping[str, float]
) -> StageModel:
    """Return the stage of an MJCF file, with constant torques among base parameters (off1 …)."""
    _read_mjcf(mujoco, path, robot.joints)
    constants = {}
    for name, value in parameters.items():
        if re.fullmatch(r"off\d+", name):
            constants[int(name[3:]) - 1] = value
            if not 1 <= int(name[3:]) <= len(robot.joints):
                raise UsageError(f"{name} is a parameter of a joint that the robot does not have")
    effects = constant_torques(robot.joints, constants)
    return StageModel(CORRECTED, path.name, robot, None, path, effects)


def require_same_native(
    mujoco: Any, path: Path, effects: Sequence[SimulatedEffect], source: FilePath
) -> None:
    """Check that no effect is simulated twice, or not at all.

    Raises UsageError: the MJCF has an effect as an element which `effects` do not mark as native,
    or the other way round.
    """
    model = mujoco.MjModel.from_xml_path(str(path))
    hint = f"the {path.name} and effects.json of one export belong together"
    elements = native_elements(mujoco, model)
    for effect in effects:
        element = BY_NAME[effect.effect].element_of
        if not element or effect.joint is None:
            continue
        joints = elements.get(effect.effect, [])
        if element == "tendon":  # its first joint
            joints = [int(model.wrap_objid[model.tendon_adr[tendon]]) for tendon in joints]
        present = effect.joint in [model.joint(joint).name for joint in joints]
        what = f"{effect.effect} at {effect.joint}"
        if effect.native and not present:
            raise UsageError(
                f"{effect.source}: {what} is native, and {path} does not have it: {hint}"
            )
        if present and not effect.native:
            raise UsageError(
                f"{path}: has {what} as an element already, and {source} would add it again: {hint}"
            )


def _read_mjcf(mujoco: Any, path: Path, joints: Sequence[str]) -> Any:
    """Read an MJCF with the robot's joints, without actuators: the replay adds motors."""
    if not is_mjcf(read_text(path, "the MJCF")):
        raise UsageError(
            f"{path}: is no MJCF: its first element is not <mujoco>; --model takes the .xml of "
            "`idim-iv export`, or `urdf` for the nominal model of the configuration"
        )
    with mujoco_reads(path):
        spec = mujoco.MjSpec.from_file(str(path))
        model = spec.copy().compile()
    named = [joint.name for joint in spec.joints]
    missing = [name for name in joints if name not in named]
    if missing:
        raise UsageError(
            f"{path}: no joint {missing[0]}; its joints are {', '.join(filter(None, named))}: is "
            "this the model of another robot?"
        )
    others = [name or "an unnamed one" for name in named if name not in joints]
    if others:
        raise UsageError(
            f"{path}: its joint {others[0]} is not among robot.joints: a replay needs a model of "
            "these joints alone"
        )
    special = getattr(mujoco.mjtGain, "mjGAIN_DCMOTOR", -1)
    pairs = zip(spec.actuators, model.actuator_gaintype, strict=True)
    motors = [actuator for actuator, gain in pairs if gain != special]
    for member in (*reversed(motors), *spec.sensors, *spec.keys):
        spec.delete(member)
    return spec
