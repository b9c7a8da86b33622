"""Effects of a diagnosis in MuJoCo: what MJCF cannot express, added at every step.

The laws, and their times of evaluation, are those of `simulation.effect_kernel`: torques that
oppose motion become dry friction and damping of the step, which MuJoCo solves together with
contacts and limits, and all others become an applied force.

`apply` writes of the joints that have effects: `dof_frictionloss` and `dof_damping` of the model,
and `qfrc_applied` of the data. But for constant torques it takes their dry friction as stiff as
MuJoCo allows (`dof_solref`, `dof_solimp`), since with the defaults a joint at rest creeps.
"""

from collections.abc import Callable, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from idim_iv_ros.compilation import entry, source_digest
from idim_iv_ros.effects import registry
from idim_iv_ros.effects.contribution import LEAST_SPEED, CommandDelay, EncoderError, LawChange
from idim_iv_ros.effects.registry import name_of, part_of
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import FilePath
from idim_iv_ros.model.link_motion import LinkFrames
from idim_iv_ros.model.mujoco_package import load_mujoco
from idim_iv_ros.simulation import dry_friction, effect_kernel
from idim_iv_ros.simulation.affected_robot import affected_plant, encoder_error
from idim_iv_ros.simulation.dry_friction import slip
from idim_iv_ros.simulation.effect_kernel import (
    LEAST_LEVEL,
    advance_states,
    effect_torques,
    states_turn,
)
from idim_iv_ros.simulation.effects import JointContributions, SimulatedEffect, contributions_of
from idim_iv_ros.simulation.plant import Contacts, Plant
from idim_iv_ros.simulators.effects_file import read_effects
from idim_iv_ros.simulators.mujoco_parts import (
    SHAFT,
    MujocoShafts,
    coupling_name,
    first_column,
    model_with_effects,
)
from idim_iv_ros.types import FloatArray, IntArray

__all__ = ["Effects", "model_with_effects"]

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
        names = _joint_names(self._mujoco, model)
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
        self._plant, self._effects = self._kernel_arguments(model, added, start_time)
        self._friction = np.zeros((2, len(self._plant.level)))
        self._mode, self._push = self._friction[0].astype(np.int64), self._friction[0].copy()
        tendons = [_tendon(model, *(self.joints[k] for k in pair)) for *pair, _ in added.couplings]
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

    def _kernel_arguments(
        self, model: Any, added: JointContributions, start_time: float
    ) -> tuple[Plant, effect_kernel.Effects]:
        """Return joint friction and effects for the kernels; MuJoCo has the rigid bodies."""
        n = len(self.joints)
        friction = model.dof_frictionloss[self._dof], first_column(model.dof_damping)[self._dof]
        joints, none, turns = np.arange(n), np.zeros(0, dtype=np.int64), np.zeros((0, 3, 3))
        base = Plant(
            frames=LinkFrames(none, none > 0, turns, np.zeros((0, 3)), turns, np.zeros(3)),
            inertial=np.zeros((0, 10)),
            drive_inertia=np.diag(model.dof_armature[self._dof]),
            damping=np.diag(friction[1]),
            offset=np.zeros(n),
            level=friction[0],
            contacts=Contacts(joints, np.full(n, -1), np.ones(n)),
        )
        return affected_plant(base, friction, added, joints, {}, start_time)

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
        error, slope = encoder_error(self._added, q)
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


def _entry(digest: str) -> Callable[..., Any]:
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
        advance_states(effects.rows, speed, effects.rest, step)
        states_turn(effects.rows, dq, ddq, step)
        for i in range(n):
            position[i], speed[i] = q[i] + 0.5 * step * dq[i], dq[i] + 0.5 * step * ddq[i]
            effects.inertial[i] = plant.drive_inertia[i, i] * ddq[i]
        for c in range(mode.shape[0]):
            mode[c] = np.sign(slip(plant.contacts, c, speed))
        effect_torques(plant, effects, time, position, speed, dq, mode, push, step)
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

    compiled: Callable[..., Any] = torques
    return compiled


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
        arrived = (1.0 - share) * sent[whole, columns] + share * sent[whole + 1, columns]
        return np.asarray(arrived)


def _tendon(model: Any, first: str, second: str) -> int:
    name = coupling_name(first, second)
    try:
        return int(model.tendon(name).id)
    except KeyError as error:
        raise UsageError(
            f"friction between {first} and {second}: the model has no tendon {name}; build it with "
            "model_with_effects(xml, effects)"
        ) from error


def _joint_names(mujoco: Any, model: Any) -> list[str]:
    """Return names of hinges and slides, without the shafts that `model_with_effects` adds."""
    kinds = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    names = [model.joint(k).name for k in range(model.njnt) if model.jnt_type[k] in kinds]
    return [name for name in names if name and not name.endswith(SHAFT)]
