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
from dataclasses import replace
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
from idim_iv_ros.effects.registry import CONTROL_LAW, part_of
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import FilePath
from idim_iv_ros.model.mujoco_package import load_mujoco
from idim_iv_ros.model.parameters import DynamicParameters
from idim_iv_ros.simulation.affected_robot import JointContributions, contributions_of, effect_rows
from idim_iv_ros.simulation.effects import SimulatedEffect, joint_effects
from idim_iv_ros.simulators.effects_file import read_effects
from idim_iv_ros.simulators.mujoco_drive import DelayLine
from idim_iv_ros.simulators.mujoco_kernel import Friction, Motion, drives, encoders, torques
from idim_iv_ros.simulators.mujoco_parts import SHAFT, coupling_name, model_with_effects
from idim_iv_ros.simulators.mujoco_shaft import MujocoShafts
from idim_iv_ros.types import FloatArray

__all__ = ["Effects", "model_with_effects"]

STIFFEST = (0.9999, 0.9999, 0.001, 0.5, 2.0)  # solimp; 0.9999 is MuJoCo's largest impedance
# Dry friction that bristles leave, as a share of the model's, at which a joint still sticks.
_STICKS = 1e-9


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
        self,
        model: Any,
        effects: FilePath | Sequence[SimulatedEffect],
        *,
        start_time: float = 0.0,
    ) -> None:
        self._mujoco = load_mujoco("Effects")
        if isinstance(effects, str | PathLike):
            effects = read_effects(Path(effects)).effects
        given = tuple(effect for effect in effects if not effect.native)
        names = _joint_names(self._mujoco, model)
        parts = joint_effects(given, names)
        affected = {j for part in parts for j in (part.joint, part.other_joint) if j >= 0}
        used = sorted(
            {*affected, *(names.index(e.joint) for e in _offsets(given, names) if e.joint)}
        )
        self.joints = tuple(names[joint] for joint in used)
        self._affected = np.isin(used, list(affected))
        # Contributions are numbered as `names`; here only joints with effects count.
        number = {joint: k for k, joint in enumerate(used)} | {-1: -1}
        parts = tuple(
            replace(part, joint=number[part.joint], other_joint=number[part.other_joint])
            for part in parts
        )
        self._start_time = start_time
        self._find(model)
        added = contributions_of(parts, _as_parameters(self._level, len(used)))
        self._offset = np.zeros(len(used))
        for one in _offsets(given, names):
            self._offset[self.joints.index(str(one.joint))] += one.parameters.get("offset", 0.0)
        self.notes = _notes(added, self.joints)
        self._shafts = MujocoShafts(self._mujoco, model, self.joints, added)
        self._compile(model, added)
        self.reset()

    def _find(self, model: Any) -> None:
        """Addresses of the joints, and what the model says of their drives."""
        own = [model.joint(name) for name in self.joints]
        self._dof = np.array([int(j.dofadr[0]) for j in own], dtype=np.int64)
        self._qpos = np.array([int(j.qposadr[0]) for j in own], dtype=np.int64)
        self._id = [int(j.id) for j in own]
        self._level = np.array(model.dof_frictionloss[self._dof])
        self._damping = np.array(_first_column(model.dof_damping)[self._dof])
        self._inertia = np.array(model.dof_armature[self._dof])

    def _compile(self, model: Any, added: JointContributions) -> None:
        n = len(self.joints)
        couplings = added.couplings
        contacts = n + len(couplings)
        rows = effect_rows(added, np.arange(n), first_coupling=n)
        level, dry = np.pad(self._level, (0, len(couplings))), np.zeros(contacts, dtype=bool)
        dissipative = np.zeros(n, dtype=bool)
        for joint, term in added.of(TorqueTerm):
            level[joint] -= term.replaced
            dissipative[joint] |= term.friction
            dry[joint] |= term.dry
        dry[:n] |= level[:n] > _STICKS * np.maximum(self._level, 1e-300)
        level[:n] = np.where(dry[:n], level[:n], 0.0)
        dry[n:] = [term.dry for _, _, term in couplings]
        self._tendons = [
            self._tendon(model, self.joints[a], self.joints[b]) for a, b, _ in couplings
        ]
        self._rows = rows
        self._friction = Friction(
            level=level,
            damping=self._damping,
            model_level=self._level,
            inertia=self._inertia,
            dry=dry,
            dissipative=dissipative,
            first=np.array([*range(n), *(a for a, _, _ in couplings)], dtype=np.int64),
            second=np.array([-1] * n + [b for _, b, _ in couplings], dtype=np.int64),
            direction=np.array([1.0] * n + [term.direction for _, _, term in couplings]),
        )
        self._now = (np.zeros(contacts), np.zeros(contacts), np.zeros(n))
        lag = np.zeros(n)
        for joint, delay in added.of(CommandDelay):
            lag[joint] += delay.seconds
        curves = any(True for _ in added.of(DriveCurve))
        self._wrong = any(True for _ in added.of(EncoderError))
        self._drive = None
        if curves or self._wrong or np.any(lag > 0.0):
            self._drive = DelayLine(self._mujoco, model, self._id, lag)
        reference = (2.0 * model.opt.timestep, 1.0)
        rubbing = (dissipative | dry[:n] | (self._level > 0.0)) & self._affected
        for dof in self._dof[rubbing]:
            model.dof_solref[dof], model.dof_solimp[dof] = reference, STIFFEST
        for tendon in self._tendons:
            model.tendon_solref_fri[tendon] = reference
            model.tendon_solimp_fri[tendon] = STIFFEST

    def _tendon(self, model: Any, first: str, second: str) -> int:
        for index in range(model.ntendon):
            if model.tendon(index).name == coupling_name(first, second):
                return index
        raise UsageError(
            f"coupling of {first} and {second}: the model has no tendon "
            f"{coupling_name(first, second)}; build it with model_with_effects(xml, effects)"
        )

    def reset(self) -> None:
        """Forget what states and delays hold; called by itself where the data's time goes back."""
        self._time = np.inf
        self._before = np.zeros(len(self.joints))
        self._rows.state[:] = 0.0
        if self._drive is not None:
            self._drive.reset()

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

        Parameters
        ----------
        model, data : mujoco.MjModel, mujoco.MjData
            With the controls of this step.
        applied
            (nv,) N m (N): what the user applies besides; `qfrc_applied` of joints with effects is
            overwritten.
        """
        time = float(data.time)
        if time < self._time and self._time != np.inf:
            self.reset()
        step = float(model.opt.timestep)
        q, dq = data.qpos[self._qpos], data.qvel[self._dof]
        first = self._time == np.inf
        if first:  # nothing was computed yet at this state
            self._mujoco.mj_forward(model, data)
        force = -self._offset
        if self._rows.state.shape[0]:
            load, static = np.empty((2, model.nv))
            self._mujoco.mj_rne(model, data, 1, load)
            self._mujoco.mj_rne(model, data, 0, static)
            push = -np.sign(data.qfrc_constraint[self._dof])
            moved = np.zeros_like(q) if first else q - self._before
            motion = Motion(
                q,
                dq,
                data.qacc[self._dof],
                load[self._dof],
                static[self._dof],
                push,
                moved,
                np.zeros_like(q),
            )
            level, damping, opposing = self._now
            torques(
                self._rows,
                self._friction,
                motion,
                self._start_time,
                time,
                step,
                level,
                damping,
                opposing,
            )
            n = len(self.joints)
            model.dof_frictionloss[self._dof] = level[:n]
            _first_column(model.dof_damping)[self._dof] = damping[:n]
            for k, tendon in enumerate(self._tendons):
                model.tendon_frictionloss[tendon] = level[n + k]
                _first_column(model.tendon_damping)[tendon] = damping[n + k]
            force = force - opposing
        if self._drive is not None:
            force = force + self._changed_drive(model, data, q, dq, step)
        self._shafts.apply(model, data)
        if applied is not None:
            force = force + applied[self._dof]
        data.qfrc_applied[self._dof] = force
        self._before, self._time = q, time

    def _changed_drive(
        self, model: Any, data: Any, q: FloatArray, dq: FloatArray, step: float
    ) -> FloatArray:
        """What acts on the joints beyond the torque that MuJoCo computes from the controls."""
        assert self._drive is not None
        shown = self.measured(data) if self._wrong else None
        own, seen = self._drive.commanded(model, data, q, dq, shown)
        acting = np.empty_like(own)
        drives(self._rows, self._drive.delayed(seen, step), acting)
        return acting - own


def _first_column(values: Any) -> Any:
    """The linear coefficient of a damping, whatever this version of MuJoCo keeps beside it."""
    return values if values.ndim == 1 else values[:, 0]


def _joint_names(mujoco: Any, model: Any) -> list[str]:
    """Names of hinges and slides, without the shafts that `model_with_effects` adds."""
    types = mujoco.mjtJoint
    names = []
    for joint in range(model.njnt):
        name, kind = model.joint(joint).name, model.jnt_type[joint]
        if name and (kind == types.mjJNT_HINGE or kind == types.mjJNT_SLIDE):
            names.append(name)
    return [name for name in names if not name.endswith(SHAFT)]


def _offsets(effects: Sequence[SimulatedEffect], names: Sequence[str]) -> list[SimulatedEffect]:
    """Constant torques, which no base parameter of MuJoCo holds."""
    return [one for one in effects if part_of(one.effect) == "offset" and one.joint in names]


def _as_parameters(level: FloatArray, joints: int) -> DynamicParameters:
    """Dry friction (n,) as what contributions read it from."""
    nothing, uncoupled = np.zeros(joints), np.zeros(0)
    return DynamicParameters(
        np.zeros((joints, 10)), nothing, nothing, level, nothing,
        np.zeros((0, 2), dtype=np.int64), uncoupled, uncoupled, uncoupled,
    )  # fmt: skip


def _notes(added: JointContributions, joints: Sequence[str]) -> tuple[str, ...]:
    return tuple(
        f"{CONTROL_LAW.name} at {joints[joint]}: the control law is the user's; set it there"
        for joint, _ in added.of(LawChange)
    )
