"""A robot in MuJoCo, and effects of a diagnosis: what MJCF cannot express, added at every step.

Parameters nearest to the nominal ones need not be physical; MuJoCo simulates them nevertheless,
but its compiler refuses them, so that they are set after compilation.

Elasticity and backlash make two masses of a joint. The joint becomes that of the motor, with its
armature, friction and actuators; a second one on the same body, ``NAME_shaft`` about the same axis,
is the position of the link less that of the motor. Friction between two joints is that of a tendon
``A_B_coupling`` over both.

The laws, and their times of evaluation, are those of `simulation.effect_kernel`: torques that
oppose motion become dry friction and damping of the step, which MuJoCo solves together with
contacts and limits, and all others become an applied force.

`apply` writes of the joints that have effects: `dof_frictionloss` and `dof_damping` of the model,
and `qfrc_applied` of the data. But for constant torques it takes their dry friction as stiff as
MuJoCo allows (`dof_solref`, `dof_solimp`), since with the defaults a joint at rest creeps.
"""

from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from idim_iv_ros.compilation import entry, source_digest
from idim_iv_ros.effects import registry
from idim_iv_ros.effects.contribution import (
    LEAST_SPEED,
    CommandDelay,
    EncoderError,
    LawChange,
    ShaftPart,
)
from idim_iv_ros.effects.registry import name_of, part_of
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import FilePath
from idim_iv_ros.model import DynamicParameters, InverseModel, RobotModel
from idim_iv_ros.model.link_motion import LinkFrames, link_frames
from idim_iv_ros.model.mjcf import load_mujoco, mujoco_reads, set_first
from idim_iv_ros.simulation import affected_robot, dry_friction, effect_kernel
from idim_iv_ros.simulation.affected_robot import affected_plant, completed_shaft
from idim_iv_ros.simulation.dry_friction import slip
from idim_iv_ros.simulation.effect_kernel import LEAST_LEVEL
from idim_iv_ros.simulation.effects import JointContributions, SimulatedEffect, contributions_of
from idim_iv_ros.simulation.plant import Contacts, Plant
from idim_iv_ros.simulators.effects_file import read_effects
from idim_iv_ros.types import FloatArray, IntArray

REPLAY = "replay_"
_LEAST_SHARE = 0.1  # of the largest value of its kind, by which a standard parameter may move
_LEAST_MASS = 1e-6  # kg


def nearest_parameters(model: InverseModel, values: FloatArray) -> DynamicParameters:
    """Return the standard parameters nearest to the nominal ones with base parameters (b,).

    Distances are relative: parameters that are small in the nominal model change little.
    """
    layout = model.regressor.layout
    nominal = layout.vector(model.robot.given)
    grouping = model.base.grouping
    kinds, sizes = np.array([parameter.kind for parameter in layout.parameters]), np.abs(nominal)
    largest = np.array([sizes[kinds == kind].max() for kind in kinds])
    weight = (sizes + _LEAST_SHARE * np.where(largest > 0.0, largest, sizes.max())) ** 2
    change = values - grouping @ nominal
    weighted = grouping * weight
    step = weighted.T @ np.linalg.lstsq(weighted @ grouping.T, change, rcond=1e-13)[0]
    return layout.dynamic_parameters(nominal + step)


def plant_spec(mujoco: Any, robot: RobotModel, parameters: DynamicParameters) -> Any:
    """Return the kinematic tree with drives and friction; `set_inertias` must follow.

    Raises UsageError: couplings of joints, which are not supported here.
    """
    if len(parameters.coupling_joints):
        raise UsageError("robot.couplings: a transmission that couples joints cannot be replayed")
    spec = mujoco.MjSpec()
    spec.modelname = robot.name
    spec.compiler.degree = False
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.gravity = robot.gravity
    turned = link_frames(robot).turned
    bodies = [spec.worldbody]
    for tree, joint in enumerate(robot.order, start=1):
        placement = robot.pinocchio.jointPlacements[tree]
        body = bodies[int(robot.pinocchio.parents[tree])].add_body(
            name=f"link_{robot.joints[joint]}",
            pos=placement.translation,
            quat=_quaternion(placement.rotation),
        )
        # A frame of inertia that is none of the body's, so that MuJoCo takes no short cut.
        body.mass, body.inertia = 1.0, [0.4, 0.5, 0.6]
        body.ipos, body.iquat = [0.1, 0.2, 0.3], [0.8, 0.4, 0.4, 0.2]
        body.explicitinertial = True
        kind = mujoco.mjtJoint
        revolute = robot.joint_types[joint] == "revolute"
        element = body.add_joint(
            name=robot.joints[joint],
            type=kind.mjJNT_HINGE if revolute else kind.mjJNT_SLIDE,
            axis=turned[tree][:, 2],
        )
        element.armature = max(float(parameters.drive_inertia[joint]), 0.0)
        element.frictionloss = max(float(parameters.coulomb[joint]), 0.0)
        set_first(element, "damping", max(float(parameters.viscous[joint]), 0.0))
        bodies.append(body)
    return spec


def add_motors(mujoco: Any, spec: Any, joints: Sequence[str]) -> None:
    """Add one motor to each joint, whose control is its torque."""
    for name in joints:
        motor = spec.add_actuator(name=REPLAY + name, target=name)
        motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
        motor.gear[0] = 1.0
        # Whatever the defaults of a user's file make of an actuator.
        motor.dyntype, motor.gaintype = mujoco.mjtDyn.mjDYN_NONE, mujoco.mjtGain.mjGAIN_FIXED
        motor.biastype, motor.gainprm[0] = mujoco.mjtBias.mjBIAS_NONE, 1.0
        motor.ctrllimited = motor.forcelimited = mujoco.mjtLimited.mjLIMITED_FALSE


def set_inertias(mujoco: Any, model: Any, robot: RobotModel, parameters: DynamicParameters) -> None:
    """Set masses and inertias of a compiled model, physical or not."""
    for joint, name in enumerate(robot.joints):
        body = int(model.jnt_bodyid[model.joint(name).id])
        mass, *_ = values = parameters.inertial[joint]
        if abs(mass) < _LEAST_MASS and np.any(np.abs(values[1:4]) > _LEAST_MASS):
            raise UsageError(f"{robot.name}: the link of {name} has a moment and no mass")
        centre = values[1:4] / mass if abs(mass) >= _LEAST_MASS else np.zeros(3)
        xx, xy, yy, xz, yz, zz = values[4:]
        origin = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        about = origin - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        moments, axes = np.linalg.eigh(about)
        if np.linalg.det(axes) < 0.0:
            axes[:, 0] *= -1.0
        model.body_mass[body], model.body_ipos[body] = mass, centre
        model.body_inertia[body], model.body_iquat[body] = moments, _quaternion(axes)
    mujoco.mj_setConst(model, mujoco.MjData(model))


def _quaternion(rotation: FloatArray) -> FloatArray:
    return np.roll(pin.Quaternion(np.asarray(rotation)).coeffs(), 1)


SHAFT, COUPLING = "_shaft", "_coupling"
# A step is at most this over the pulsation of a shaft, rad; MuJoCo's springs are explicit.
LARGEST_ANGLE = 0.8


class StepTooLongError(UsageError):
    """The time step of a model does not resolve one of its shafts."""


def model_with_effects(model: FilePath, effects: FilePath) -> Any:
    """Compile an MJCF with the parts that the effects of a file need.

    Without elasticity, backlash and joint coupling it is the model of the file as it is.

    Raises UsageError: MuJoCo is not installed, a file cannot be read, an effect or joint is not
    known.
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
    parts = contributions_of([effect for effect in effects if not effect.native], joints)
    for name in dict.fromkeys(joints[joint] for joint, _ in parts.of(ShaftPart)):
        if spec.joint(name + SHAFT) is not None:
            continue
        motor = spec.joint(name)
        if float(motor.armature) <= 0.0:
            raise UsageError(
                f"elasticity or backlash at {name} needs its drive inertia: the joint has no "
                "armature"
            )
        if len(motor.parent.joints) > 1:
            raise UsageError(f"elasticity or backlash at {name}: its body has several joints")
        shaft = motor.parent.add_joint(
            name=name + SHAFT, type=motor.type, pos=motor.pos, axis=motor.axis
        )
        for key in ("armature", "frictionloss", "damping", "stiffness"):  # not those of a default
            setattr(shaft, key, 0.0 * getattr(motor, key))
    for first, second, term in parts.couplings:
        name = coupling_name(joints[first], joints[second])
        if spec.tendon(name) is None:
            tendon = spec.add_tendon(name=name)
            tendon.wrap_joint(joints[first], 1.0)
            tendon.wrap_joint(joints[second], float(term.direction))


def coupling_name(first: str, second: str) -> str:
    """Return the name of the tendon that couples two joints."""
    return f"{first}_{second}{COUPLING}"


class MujocoShafts:
    """Shafts of the joints that have one, as joints ``NAME_shaft``: link less motor position.

    Such a joint has stiffness and damping outside of its backlash, and neither within it.

    Raises UsageError: the model has no such joint, or its time step is too long for the shaft.
    """

    def __init__(
        self, mujoco: Any, model: Any, joints: Sequence[str], added: JointContributions
    ) -> None:
        self._mujoco = mujoco
        # Each with the numbers of its joint, its position and its velocity in the model.
        self._shafts: list[tuple[ShaftPart, int, int, int]] = []
        present = {model.joint(k).name for k in range(model.njnt)}
        for place, shaft in affected_robot.joined_shafts(added.of(ShaftPart)).items():
            name = joints[place]
            if name + SHAFT not in present:
                raise UsageError(
                    f"elasticity or backlash at {name}: the model has no joint {name + SHAFT}; "
                    "build it with model_with_effects(xml, effects)"
                )
            joint = model.joint(name + SHAFT)
            dof = int(joint.dofadr[0])
            data = mujoco.MjData(model)
            mujoco.mj_forward(model, data)
            unit, response = np.zeros((2, 1, model.nv))
            unit[0, dof] = 1.0
            mujoco.mj_solveM(model, data, response, unit)
            # The motor is not held: its own inertia is part of the mobility of the twist.
            complete, pulsation = completed_shaft(shaft, 1.0 / float(response[0, dof]))
            longest = LARGEST_ANGLE / pulsation
            if model.opt.timestep > longest:
                raise StepTooLongError(
                    f"elasticity or backlash at {name} swings fast: the model's timestep is "
                    f"{model.opt.timestep:g} s and {longest:.2g} s or less is needed"
                )
            self._shafts.append((complete, int(joint.id), int(joint.qposadr[0]), dof))

    def apply(self, model: Any, data: Any) -> None:
        """Set stiffness and damping of the shafts for this step."""
        for shaft, joint, place, dof in self._shafts:
            twist, rate = -data.qpos[place], -data.qvel[dof]
            stiffness, damping = shaft.stiffness, shaft.damping
            side = 1.0 if twist > 0.0 else -1.0
            if shaft.gap > 0.0:
                bent = side * twist - 0.5 * shaft.gap
                if bent <= 0.0 or stiffness * bent + damping * side * rate <= 0.0:
                    stiffness = damping = 0.0
            model.qpos_spring[place] = -0.5 * side * shaft.gap
            first_column(model.jnt_stiffness)[joint] = stiffness
            first_column(model.dof_damping)[dof] = damping

    def place(self, model: Any, data: Any) -> None:
        """Put the links at rest into equilibrium with gravity behind their motors."""
        load, speed = np.empty(model.nv), np.array(data.qvel)
        for _ in range(30 if self._shafts else 0):
            data.qvel[:] = 0.0
            self._mujoco.mj_fwdPosition(model, data)
            self._mujoco.mj_fwdVelocity(model, data)
            self._mujoco.mj_rne(model, data, 0, load)
            for shaft, _, place, dof in self._shafts:
                bent = load[dof] / shaft.stiffness + 0.5 * shaft.gap * np.sign(load[dof])
                data.qpos[place] = -bent
                speed[dof] = 0.0
        data.qvel[:] = speed


def first_column(values: Any) -> Any:
    """Return the linear coefficients of stiffness or damping, in any version of MuJoCo."""
    return values if values.ndim == 1 else values[:, 0]


STIFFEST = (0.9999, 0.9999, 0.001, 0.5, 2.0)  # solimp; 0.9999 is MuJoCo's largest impedance


class Effects:
    """Effects of a robot in a MuJoCo model.

    - `model`: mujoco.MjModel with the joint names of the effects; it is changed: see `apply`
    - `effects`: a file of effects or a diagnosis (gap.json); effects that are marked `native` are
      passed over: the model has them
    - `start_time`: s since the start of the session at which the data's time is zero, for friction
      that drifts through it; what starts anew with each recording counts from there
    - `notes`: sentences on effects that are not simulated: the user changes the control law

    Raises UsageError: an effect, parameter or joint that is not known; a shaft or a coupling that
    the model has no parts for (`model_with_effects`), or a time step that is too long for a shaft.
    """

    def __init__(
        self, model: Any, effects: FilePath | Sequence[SimulatedEffect], *, start_time: float = 0.0
    ) -> None:
        self._mujoco = load_mujoco("Effects")
        if isinstance(effects, str | PathLike):
            effects = read_effects(Path(effects)).effects
        given = [effect for effect in effects if not effect.native]
        # Hinges and slides, without the shafts that `model_with_effects` adds.
        kinds = self._mujoco.mjtJoint
        moving = np.isin(model.jnt_type, [int(kinds.mjJNT_HINGE), int(kinds.mjJNT_SLIDE)])
        names = [model.joint(k).name for k in np.flatnonzero(moving)]
        names = [name for name in names if name and not name.endswith(SHAFT)]
        affected = {names[joint] for joint in contributions_of(given, names).joints}
        constant = [effect for effect in given if part_of(effect.effect) == "offset"]
        used = affected | {effect.joint for effect in constant}
        self.joints = tuple(name for name in names if name in used)
        joints = [model.joint(name) for name in self.joints]
        self._dof = np.array([int(joint.dofadr[0]) for joint in joints], dtype=np.int64)
        self._qpos = np.array([int(joint.qposadr[0]) for joint in joints], dtype=np.int64)
        # Numbered as the joints with effects, not as all of the model.
        added = contributions_of(given, self.joints, model.dof_frictionloss[self._dof])
        self._added = added
        self._offset = np.zeros(len(joints))
        for effect in constant:
            at = [name == effect.joint for name in self.joints]
            self._offset[at] += effect.parameters.get("offset", 0.0)
        self.notes = tuple(
            f"{name_of('gains')} at {self.joints[joint]}: the control law is the user's; set it "
            "there"
            for joint, _ in added.of(LawChange)
        )
        self._shafts = MujocoShafts(self._mujoco, model, self.joints, added)
        # For the kernels: MuJoCo has the rigid bodies.
        friction = model.dof_frictionloss[self._dof], first_column(model.dof_damping)[self._dof]
        place, none, turns = np.arange(len(joints)), np.zeros(0, np.int64), np.zeros((0, 3, 3))
        base = Plant(
            frames=LinkFrames(none, none > 0, turns, np.zeros((0, 3)), turns, np.zeros(3)),
            inertial=np.zeros((0, 10)),
            drive_inertia=np.diag(model.dof_armature[self._dof]),
            damping=np.diag(friction[1]),
            offset=np.zeros(len(joints)),
            level=friction[0],
            contacts=Contacts(place, np.full(len(joints), -1), np.ones(len(joints))),
        )
        self._plant, self._effects = affected_plant(base, friction, added, place, {}, start_time)
        self._friction = np.zeros((2, len(self._plant.level)))
        self._mode, self._push = self._friction[0].astype(np.int64), self._friction[0].copy()
        present = {model.tendon(k).name: k for k in range(model.ntendon)}
        tendons = []
        for first, second, _ in added.couplings:
            pair = (self.joints[first], self.joints[second])
            name = coupling_name(*pair)
            if name not in present:
                raise UsageError(
                    f"friction between {' and '.join(pair)}: the model has no tendon {name}; build "
                    "it with model_with_effects(xml, effects)"
                )
            tendons.append(present[name])
        self._tendons = np.array(tendons, dtype=np.int64)
        rubbing = self._effects.dissipative | self._effects.dry[: len(joints)]
        rubbing |= self._effects.model_level[: len(joints)] > 0.0
        rubbing &= [name in affected for name in self.joints]
        reference = (2.0 * model.opt.timestep, 1.0)
        for dof in self._dof[rubbing]:
            model.dof_solref[dof], model.dof_solimp[dof] = reference, STIFFEST
        for tendon in self._tendons:
            model.tendon_solref_fri[tendon] = reference
            model.tendon_solimp_fri[tendon] = STIFFEST
        lag = np.zeros(len(joints))
        for joint, delay in added.of(CommandDelay):
            lag[joint] += delay.seconds
        self._wrong = any(added.of(EncoderError))
        self._drive = None
        if self._wrong or np.any(lag > 0.0) or added.curves:
            self._drive = _DelayLine(self._mujoco, model, [int(joint.id) for joint in joints], lag)
        self.reset()

    def reset(self) -> None:
        """Reset internal states and delays; done automatically where the data's time goes back."""
        self._time = np.inf
        self._before = np.zeros(len(self.joints))
        self._effects.rows.state[:] = 0.0
        if self._drive is not None:
            self._drive.sent = []

    def position(self, data: Any) -> FloatArray:
        """Return measured positions of `joints`, (n,) rad (m): motor side, with encoder errors."""
        return np.asarray(self.measured(data)[0])

    def measured(self, data: Any) -> FloatArray:
        """Return the measured positions and velocities (2, n) of `joints`, encoder errors added."""
        q, dq = data.qpos[self._qpos], data.qvel[self._dof]
        error, slope = affected_robot.encoder_error(self._added, q)
        return np.stack([q + error, dq * (1.0 + slope)])

    def place_links(self, model: Any, data: Any) -> None:
        """Put links behind shafts into equilibrium with gravity; motor positions are kept."""
        self._shafts.place(model, data)

    def apply(self, model: Any, data: Any, applied: FloatArray | None = None) -> None:
        """Set friction, damping and applied forces for the step that follows.

        - `model`, `data`: mujoco.MjModel, mujoco.MjData, with the controls of this step
        - `applied`: (nv,) N m (N): what the user applies besides; `qfrc_applied` of joints with
          effects is overwritten
        """
        time = float(data.time)
        if time < self._time and self._time != np.inf:
            self.reset()
        q, dq = data.qpos[self._qpos], data.qvel[self._dof]
        if self._time == np.inf:  # nothing was computed yet at this state
            self._mujoco.mj_forward(model, data)
            self._before = q
        force = -self._offset
        if self._effects.rows.state.shape[0]:
            force -= self._frictions(model, data, q, dq)
        if self._drive is not None:
            # What acts on the joints beyond the torque that MuJoCo computes from the controls.
            sent = seen = self._drive.commanded(model, data, q, dq)
            if self._wrong:
                seen = self._drive.commanded(model, data, *self.measured(data))
            acting = self._drive.delayed(seen, float(model.opt.timestep))
            for joint, curve in self._added.curves:
                whole = curve.law.curve.py_func  # type: ignore[attr-defined]
                acting[joint] = whole(curve.values, acting[joint])
            force += acting - sent
        self._shafts.apply(model, data)
        if applied is not None:
            force += applied[self._dof]
        data.qfrc_applied[self._dof] = force
        self._before, self._time = q, time

    def _frictions(self, model: Any, data: Any, q: FloatArray, dq: FloatArray) -> FloatArray:
        """Set friction and damping of this step; return the other effects' torque, (n,) N m (N)."""
        n, step, torque = len(self.joints), float(model.opt.timestep), np.empty(model.nv)
        for acceleration, load in ((1, self._effects.load), (0, self._effects.static)):
            self._mujoco.mj_rne(model, data, acceleration, torque)
            load[:] = torque[self._dof]
        self._push[:n] = -np.sign(data.qfrc_constraint[self._dof])
        motion = (q, dq, data.qacc[self._dof], q - self._before)
        friction = self._plant, self._effects, self._mode, self._push, self._friction
        _torques(*friction, float(data.time) + 0.5 * step, *motion, step)
        level, damping = self._friction
        model.dof_frictionloss[self._dof] = level[:n]
        first_column(model.dof_damping)[self._dof] = damping[:n]
        for values, now in (
            (model.tendon_frictionloss, level),
            (first_column(model.tendon_damping), damping),
        ):
            values[self._tendons] = 0.0
            np.add.at(values, self._tendons, now[n:])
        return self._effects.force


def _entry(digest: str) -> Any:
    """Compile the kernel that Python calls; `digest` is part of its key in numba's cache."""

    @entry
    def torques(
        plant: Plant,
        effects: effect_kernel.Effects,
        mode: IntArray,
        push: FloatArray,
        friction: FloatArray,
        time: float,
        q: FloatArray,
        dq: FloatArray,
        ddq: FloatArray,
        moved: FloatArray,
        step: float,
    ) -> None:
        """Write dry and viscous friction (2, contacts) of one step, and the force of the effects.

        `ddq` is that of the last step, `moved` the way since then; `push` the direction in which a
        contact at rest would be moved. `mode` is written over.
        """
        _ = digest
        n, position, speed = dq.shape[0], effects.link_q, effects.link_speed
        # States along the way that MuJoCo has just gone, and then all in the middle of this step.
        for i in range(n):
            speed[i] = moved[i] / step
        effect_kernel.advance_states(effects.rows, speed, effects.rest, step)
        effect_kernel.states_turn(effects.rows, dq, ddq, step)
        for i in range(n):
            position[i], speed[i] = q[i] + 0.5 * step * dq[i], dq[i] + 0.5 * step * ddq[i]
            effects.inertial[i] = plant.drive_inertia[i, i] * ddq[i]
        for c in range(mode.shape[0]):
            mode[c] = np.sign(slip(plant.contacts, c, speed))
        effect_kernel.effect_torques(plant, effects, time, position, speed, dq, mode, push, step)
        # Damping of couplings goes to their tendons; off the diagonal is no other.
        for c in range(n, mode.shape[0]):
            first, second = plant.contacts.first[c], plant.contacts.second[c]
            friction[1, c] = plant.contacts.direction[c] * plant.damping[first, second]
            plant.damping[first, first] -= friction[1, c]
            plant.damping[second, second] -= friction[1, c]
            plant.damping[first, second] = 0.0  # another one of the same joints has it no more
        # Stiffness half a step ahead, where MuJoCo's implicit damping puts the velocity.
        for i in range(n):
            stiff = 0.5 * step * effects.stiffness[i, i]
            friction[1, i] = plant.damping[i, i] + stiff
            effects.force[i] -= stiff * dq[i]
        for c in range(mode.shape[0]):
            friction[0, c] = plant.level[c]
            if friction[1, c] < 0.0 and (c >= n or effects.dissipative[c]):
                # Less friction at higher speed: a lower level, which cannot drive.
                moving = max(abs(slip(plant.contacts, c, dq)), LEAST_SPEED)
                friction[0, c] += friction[1, c] * moving
                friction[1, c] = 0.0
            friction[0, c] = max(friction[0, c], LEAST_LEVEL if effects.dry[c] else 0.0)

    return torques


_torques = _entry(source_digest(dry_friction, effect_kernel, *registry.MODULES))


class _DelayLine:
    """Delay of the actuator torques of some joints (by number); `delay` (n,) s."""

    def __init__(self, mujoco: Any, model: Any, joints: list[int], delay: FloatArray) -> None:
        self._mujoco, self._delay = mujoco, delay
        self._dof = model.jnt_dofadr[joints]
        driven = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
        driven &= np.isin(model.actuator_trnid[:, 0], joints)
        self._actuators = np.flatnonzero(driven)
        self._place = [joints.index(int(joint)) for joint in model.actuator_trnid[driven, 0]]
        self._gear = model.actuator_gear[driven, 0]
        self.sent: list[FloatArray] = []

    def commanded(self, model: Any, data: Any, q: FloatArray, dq: FloatArray) -> FloatArray:
        """Return the actuators' torque (n,) at positions and velocities."""
        data.actuator_length[self._actuators] = self._gear * q[self._place]
        data.actuator_velocity[self._actuators] = self._gear * dq[self._place]
        self._mujoco.mj_fwdActuation(model, data)
        return np.array(data.qfrc_actuator[self._dof])

    def delayed(self, torque: FloatArray, step: float) -> FloatArray:
        """Return the delayed torque (n,) for a step, s: the mean where a command changes within it.

        Before the first step, the first command is taken as constant.
        """
        whole = np.floor(self._delay / step + 1e-9).astype(np.int64)
        if not self.sent:
            self.sent = [torque] * (int(whole.max(initial=0)) + 2)
        self.sent = [torque, *self.sent[:-1]]
        share = self._delay / step - whole
        sent, columns = np.array(self.sent), np.arange(len(torque))
        return np.asarray((1.0 - share) * sent[whole, columns] + share * sent[whole + 1, columns])
