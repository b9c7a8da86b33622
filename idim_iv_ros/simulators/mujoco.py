"""Effects of a diagnosis in MuJoCo: what its XML cannot say, added at every step.

::

    model = model_with_effects("arm.xml", "effects.json")
    data = mujoco.MjData(model)
    effects = Effects(model, "effects.json")
    while running:
        data.ctrl[:] = control(effects.position(data))
        effects.apply(model, data)
        mujoco.mj_step(model, data)

`apply` writes of the joints that have effects: `dof_frictionloss` and `dof_damping` of the model,
and `qfrc_applied` of the data. But for constant torques it takes their dry friction as stiff as
MuJoCo allows (`dof_solref`, `dof_solimp`), since with the defaults a joint at rest creeps.
"""

from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from idim_iv_ros.effects.contribution import (
    CommandDelay,
    DriveCurve,
    EncoderError,
    LawChange,
    TorqueTerm,
)
from idim_iv_ros.effects.registry import name_of, part_of
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import FilePath
from idim_iv_ros.model.mujoco_package import load_mujoco
from idim_iv_ros.simulation.affected_robot import (
    STICKS,
    JointContributions,
    contributions_of,
    effect_rows,
)
from idim_iv_ros.simulation.effects import SimulatedEffect, joint_effects
from idim_iv_ros.simulators.effects_file import read_effects
from idim_iv_ros.simulators.mujoco_kernel import Friction, Motion, drives, encoders, torques
from idim_iv_ros.simulators.mujoco_parts import (
    SHAFT,
    MujocoShafts,
    coupling_name,
    first_column,
    model_with_effects,
)
from idim_iv_ros.types import FloatArray

__all__ = ["Effects", "model_with_effects"]

STIFFEST = (0.9999, 0.9999, 0.001, 0.5, 2.0)  # solimp; 0.9999 is MuJoCo's largest impedance


class Effects:
    """Effects of a robot in a MuJoCo model.

    Parameters
    ----------
    model : mujoco.MjModel
        Its joints are found by the names in the file. It is changed: see `apply`.
    effects : str, Path or sequence of SimulatedEffect
        A file of effects or a diagnosis (gap.json). Effects that are marked `native` are passed
        over: the model has them.
    start_time : float
        s since the start of the session at which the data's time is zero, for friction that drifts
        through it; what starts anew with each recording counts from there.

    Attributes
    ----------
    notes : tuple of str
        What is not done here, a sentence each: changes of the control law are the user's.

    Raises
    ------
    UsageError
        An effect, parameter or joint that is not known; a shaft or a coupling that the model has
        no parts for (`model_with_effects`), or a time step that is too long for a shaft.
    """

    def __init__(
        self, model: Any, effects: FilePath | Sequence[SimulatedEffect], *, start_time: float = 0.0
    ) -> None:
        self._mujoco = load_mujoco("Effects")
        self._start_time = start_time
        if isinstance(effects, str | PathLike):
            effects = read_effects(Path(effects)).effects
        given = [effect for effect in effects if not effect.native]
        names = _joint_names(self._mujoco, model)
        parts = joint_effects(given, names)
        affected = {names[j] for part in parts for j in (part.joint, part.other_joint) if j >= 0}
        constant = [effect for effect in given if part_of(effect.effect) == "offset"]
        used = affected | {effect.joint for effect in constant}
        self.joints = tuple(name for name in names if name in used)
        joints = [model.joint(name) for name in self.joints]
        self._dof = np.array([int(joint.dofadr[0]) for joint in joints], dtype=np.int64)
        self._qpos = np.array([int(joint.qposadr[0]) for joint in joints], dtype=np.int64)
        # Numbered as the joints with effects, not as all of the model.
        numbered = joint_effects(given, self.joints)
        added = contributions_of(numbered, model.dof_frictionloss[self._dof])
        self._offset = np.zeros(len(joints))
        for effect in constant:
            if effect.joint in self.joints:
                place = self.joints.index(effect.joint)
                self._offset[place] += effect.parameters.get("offset", 0.0)
        self.notes = tuple(
            f"{name_of('gains')} at {self.joints[joint]}: the control law is the user's; set it "
            "there"
            for joint, _ in added.of(LawChange)
        )
        self._shafts = MujocoShafts(self._mujoco, model, self.joints, added)
        self._compile(model, added)
        rubbing = self._friction.dissipative | self._friction.dry[: len(joints)]
        rubbing |= self._friction.model_level > 0.0
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
        if self._wrong or np.any(lag > 0.0) or any(added.of(DriveCurve)):
            self._drive = _DelayLine(self._mujoco, model, [int(joint.id) for joint in joints], lag)
        self.reset()

    def _compile(self, model: Any, added: JointContributions) -> None:
        """Shape friction and contributions for compiled code; find the tendons of couplings."""
        n, couplings = len(self.joints), added.couplings
        model_level = np.array(model.dof_frictionloss[self._dof])
        level, dry = np.pad(model_level, (0, len(couplings))), np.zeros(n + len(couplings), bool)
        dissipative = np.zeros(n, dtype=bool)
        for joint, term in added.of(TorqueTerm):
            level[joint] -= term.replaced
            dissipative[joint] |= term.friction
            dry[joint] |= term.dry
        dry[:n] |= level[:n] > STICKS * np.maximum(model_level, 1e-300)
        level[:n] = np.where(dry[:n], level[:n], 0.0)
        dry[n:] = [term.dry for _, _, term in couplings]
        self._tendons = [
            _tendon(model, self.joints[first], self.joints[second])
            for first, second, _ in couplings
        ]
        self._rows = effect_rows(added, np.arange(n), first_coupling=n)
        self._friction = Friction(
            level=level,
            damping=np.array(first_column(model.dof_damping)[self._dof]),
            model_level=model_level,
            inertia=np.array(model.dof_armature[self._dof]),
            dry=dry,
            dissipative=dissipative,
            first=np.array([*range(n), *(first for first, _, _ in couplings)], dtype=np.int64),
            second=np.array([-1] * n + [second for _, second, _ in couplings], dtype=np.int64),
            direction=np.array([1.0] * n + [term.direction for _, _, term in couplings]),
        )
        self._now = (np.zeros_like(level), np.zeros_like(level), np.zeros(n))

    def reset(self) -> None:
        """Forget what states and delays hold; called by itself where the data's time goes back."""
        self._time = np.inf
        self._before = np.zeros(len(self.joints))
        self._rows.state[:] = 0.0
        if self._drive is not None:
            self._drive.sent = []

    def position(self, data: Any) -> FloatArray:
        """What the encoders show of `joints`, (n,) rad (m): of the motors, with their errors."""
        return np.asarray(self.measured(data)[0])

    def measured(self, data: Any) -> FloatArray:
        """Positions and velocities (2, n) of `joints` as the encoders show them."""
        shown = np.empty((2, len(self.joints)))
        encoders(self._rows, data.qpos[self._qpos], data.qvel[self._dof], shown)
        return shown

    def place_links(self, model: Any, data: Any) -> None:
        """Put links behind shafts where gravity holds them; positions of their motors are kept."""
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
        if self._rows.state.shape[0]:
            force -= self._frictions(model, data, q, dq)
        if self._drive is not None:
            # What acts on the joints beyond the torque that MuJoCo computes from the controls.
            sent = seen = self._drive.commanded(model, data, q, dq)
            if self._wrong:
                seen = self._drive.commanded(model, data, *self.measured(data))
            acting = np.empty_like(sent)
            drives(self._rows, self._drive.delayed(seen, float(model.opt.timestep)), acting)
            force += acting - sent
        self._shafts.apply(model, data)
        if applied is not None:
            force += applied[self._dof]
        data.qfrc_applied[self._dof] = force
        self._before, self._time = q, time

    def _frictions(self, model: Any, data: Any, q: FloatArray, dq: FloatArray) -> FloatArray:
        """Set friction and damping of this step; return what else opposes the motors, (n,) N m."""
        load, static = np.empty((2, model.nv))
        self._mujoco.mj_rne(model, data, 1, load)
        self._mujoco.mj_rne(model, data, 0, static)
        push = -np.sign(data.qfrc_constraint[self._dof])
        acceleration, rest = data.qacc[self._dof], np.zeros_like(q)
        loads = (load[self._dof], static[self._dof])
        motion = Motion(q, dq, acceleration, *loads, push, q - self._before, rest)
        time, step = float(data.time), float(model.opt.timestep)
        torques(self._rows, self._friction, motion, self._start_time, time, step, *self._now)
        level, damping, opposing = self._now
        n = len(self.joints)
        model.dof_frictionloss[self._dof] = level[:n]
        first_column(model.dof_damping)[self._dof] = damping[:n]
        for k, tendon in enumerate(self._tendons, n):
            model.tendon_frictionloss[tendon] = level[k]
            first_column(model.tendon_damping)[tendon] = damping[k]
        return opposing


class _DelayLine:
    """Torques of the actuators of some joints (by their numbers) on their way, (n,) s late."""

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
        """Torque (n,) of the actuators at a motion."""
        data.actuator_length[self._actuators] = self._gear * q[self._place]
        data.actuator_velocity[self._actuators] = self._gear * dq[self._place]
        self._mujoco.mj_fwdActuation(model, data)
        return np.array(data.qfrc_actuator[self._dof])

    def delayed(self, torque: FloatArray, step: float) -> FloatArray:
        """What arrives in a step of this length, (n,): the mean where a command ends within it.

        The first command is taken to have been held before.
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
    for index in range(model.ntendon):
        if model.tendon(index).name == name:
            return index
    raise UsageError(
        f"friction between {first} and {second}: the model has no tendon {name}; build it with "
        "model_with_effects(xml, effects)"
    )


def _joint_names(mujoco: Any, model: Any) -> list[str]:
    """Names of hinges and slides, without the shafts that `model_with_effects` adds."""
    kinds = [int(kind) for kind in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)]
    joints = [joint for joint in range(model.njnt) if model.jnt_type[joint] in kinds]
    names = [model.joint(joint).name for joint in joints]
    return [name for name in names if name and not name.endswith(SHAFT)]
