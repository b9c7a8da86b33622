"""Elastic shafts and play between motor and link in MuJoCo: springs of joints of their own."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from idim_iv_ros.effects.contribution import ShaftPart
from idim_iv_ros.errors import UsageError
from idim_iv_ros.simulation.affected_robot import JointContributions
from idim_iv_ros.simulation.shaft import (
    FASTEST,
    FLANK_DAMPING,
    FLANK_FREQUENCY,
    Shaft,
    joined_shafts,
)
from idim_iv_ros.simulators.mujoco_parts import SHAFT

# A step is at most this over the pulsation of a shaft, rad; MuJoCo's springs are explicit.
LARGEST_ANGLE = 0.8


class StepTooLongError(UsageError):
    """The time step of a model does not resolve one of its shafts."""


class MujocoShafts:
    """Shafts of the joints that have one, as joints ``NAME_shaft``: link less motor.

    Flanks only push: beyond the play such a joint has its stiffness and damping, within it neither.

    Raises
    ------
    UsageError
        The model has no such joint, or its time step is too long for the shaft.
    """

    def __init__(
        self,
        mujoco: Any,
        model: Any,
        joints: Sequence[str],
        added: JointContributions,
    ) -> None:
        self._mujoco = mujoco
        self.shafts: list[Shaft] = []
        self._joint: list[int] = []
        self._qpos: list[int] = []
        self._dof: list[int] = []
        known = {model.joint(k).name for k in range(model.njnt)}
        for shaft in joined_shafts(added.of(ShaftPart)):
            name = joints[shaft.joint]
            if name + SHAFT not in known:
                raise UsageError(
                    f"elasticity or backlash at {name}: the model has no joint {name + SHAFT}; "
                    "build it with model_with_effects(xml, effects)"
                )
            own = model.joint(name + SHAFT)
            self._joint.append(int(own.id))
            self._qpos.append(int(own.qposadr[0]))
            self._dof.append(int(own.dofadr[0]))
            self.shafts.append(self._complete(model, shaft, name))

    def _complete(self, model: Any, shaft: Shaft, name: str) -> Shaft:
        """Stiffness and damping that are not given, from the inertias of motor and link."""
        data = self._mujoco.MjData(model)
        self._mujoco.mj_forward(model, data)
        response = np.zeros((1, model.nv))
        response[0, self._dof[-1]] = 1.0
        self._mujoco.mj_solveM(model, data, response, response.copy())
        # The motor is not held: its own inertia is part of the mobility of the twist.
        reduced = 1.0 / float(response[0, self._dof[-1]])
        stiffness, damping = shaft.stiffness, shaft.damping
        if np.isnan(stiffness):
            stiffness = reduced * (2.0 * np.pi * FLANK_FREQUENCY) ** 2
        stiffness = min(stiffness, reduced * FASTEST**2)
        if np.isnan(damping):
            damping = 2.0 * FLANK_DAMPING * float(np.sqrt(stiffness * reduced))
        longest = LARGEST_ANGLE / float(np.sqrt(stiffness / reduced))
        if model.opt.timestep > longest:
            raise StepTooLongError(
                f"elasticity or backlash at {name} swings fast: the model's timestep is "
                f"{model.opt.timestep:g} s and {longest:.2g} s or less is needed"
            )
        return replace(shaft, stiffness=stiffness, damping=damping)

    def apply(self, model: Any, data: Any) -> None:
        """Set stiffness and damping of this step."""
        for k, shaft in enumerate(self.shafts):
            twist, rate = -data.qpos[self._qpos[k]], -data.qvel[self._dof[k]]
            stiffness, damping = shaft.stiffness, shaft.damping
            side = 1.0 if twist > 0.0 else -1.0
            if shaft.gap > 0.0:
                bent = side * twist - 0.5 * shaft.gap
                if bent <= 0.0 or stiffness * bent + damping * side * rate <= 0.0:
                    stiffness = damping = 0.0
            model.qpos_spring[self._qpos[k]] = -0.5 * side * shaft.gap
            _set(model.jnt_stiffness, self._joint[k], stiffness)
            _set(model.dof_damping, self._dof[k], damping)

    def place(self, model: Any, data: Any) -> None:
        """Put the links where gravity holds them behind their motors, all at rest."""
        load = np.empty(model.nv)
        speed = np.array(data.qvel)
        speed[self._dof] = 0.0
        for _ in range(30 if self.shafts else 0):
            data.qvel[:] = 0.0
            self._mujoco.mj_fwdPosition(model, data)
            self._mujoco.mj_fwdVelocity(model, data)
            self._mujoco.mj_rne(model, data, 0, load)
            for k, shaft in enumerate(self.shafts):
                torque = load[self._dof[k]]
                bent = torque / shaft.stiffness + 0.5 * shaft.gap * np.sign(torque)
                data.qpos[self._qpos[k]] = -bent
        data.qvel[:] = speed


def _set(values: Any, index: int, value: float) -> None:
    if values.ndim == 1:
        values[index] = value
    else:
        values[index, 0] = value
