"""From the controls of a MuJoCo model to the torque of a drive that is late or sees otherwise."""

from typing import Any

import numpy as np

from idim_iv_ros.types import FloatArray


class DelayLine:
    """Torques of the joints' actuators on their way.

    Parameters
    ----------
    model : mujoco.MjModel
    joints
        Numbers of the driven joints.
    delay
        (n,) s.
    """

    def __init__(self, mujoco: Any, model: Any, joints: list[int], delay: FloatArray) -> None:
        self._mujoco, self._delay = mujoco, delay
        self._dof = model.jnt_dofadr[joints]
        pairs = [
            (actuator, joints.index(int(model.actuator_trnid[actuator, 0])))
            for actuator in range(model.nu)
            if model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT
            and int(model.actuator_trnid[actuator, 0]) in joints
        ]
        self._actuators = np.array([actuator for actuator, _ in pairs], dtype=np.int64)
        self._place = np.array([place for _, place in pairs], dtype=np.int64)
        self._gear = np.array([model.actuator_gear[actuator, 0] for actuator, _ in pairs])
        self._sent: list[FloatArray] = []

    def reset(self) -> None:
        """Nothing is on its way."""
        self._sent = []

    def commanded(
        self, model: Any, data: Any, q: FloatArray, dq: FloatArray, shown: FloatArray | None
    ) -> tuple[FloatArray, FloatArray]:
        """Torque (n,) of the actuators at the true motion, and at what the encoders show (2, n)."""
        own = self._torque(model, data, q, dq)
        return own, own if shown is None else self._torque(model, data, shown[0], shown[1])

    def _torque(self, model: Any, data: Any, q: FloatArray, dq: FloatArray) -> FloatArray:
        data.actuator_length[self._actuators] = self._gear * q[self._place]
        data.actuator_velocity[self._actuators] = self._gear * dq[self._place]
        self._mujoco.mj_fwdActuation(model, data)
        return np.array(data.qfrc_actuator[self._dof])

    def delayed(self, torque: FloatArray, step: float) -> FloatArray:
        """What arrives in a step of this length, (n,): the mean where a command ends within it.

        The first command is taken to have been held before.
        """
        whole = np.floor(self._delay / step + 1e-9).astype(np.int64)
        if not self._sent:
            self._sent = [torque] * (int(whole.max(initial=0)) + 2)
        self._sent = [torque, *self._sent[:-1]]
        share = self._delay / step - whole
        sent = np.array(self._sent)
        columns = np.arange(len(torque))
        arrived = (1.0 - share) * sent[whole, columns] + share * sent[whole + 1, columns]
        return np.asarray(arrived)
