"""Regressor of the inverse dynamic model (paper, equation 3)."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from idim_iv_ros.model.link_frames import LinkFrames, link_frames
from idim_iv_ros.model.link_motion import link_motion
from idim_iv_ros.model.parameters import INERTIAL, REGRESSOR_ORDER, ParameterLayout
from idim_iv_ros.model.regressor_kernel import inertial_columns
from idim_iv_ros.model.robot import RobotModel
from idim_iv_ros.types import FloatArray, IntArray


@dataclass(frozen=True)
class StandardRegressor:
    """Matrix of basis functions of the standard parameters: τ = IDM(q, dq, ddq) β.

    Attributes
    ----------
    robot : RobotModel
    layout : ParameterLayout
        Columns of the matrix.
    """

    robot: RobotModel
    layout: ParameterLayout

    def __call__(self, q: FloatArray, dq: FloatArray, ddq: FloatArray) -> FloatArray:
        """Evaluate at n_samples states.

        Parameters
        ----------
        q, dq, ddq
            (n_samples, n_joints) rad, rad/s, rad/s² (m, … for prismatic joints).

        Returns
        -------
        (n_samples, n_joints, n_standard)
        """
        samples, joints = q.shape
        matrix = np.zeros((samples, joints, len(self.layout.parameters)))
        order = self.robot.order
        motion = (np.ascontiguousarray(values[:, order], dtype=float) for values in (q, dq, ddq))
        inertial_columns(
            self._frames,
            *motion,
            link_motion(joints),
            np.empty((3, 4)),
            np.empty(10),
            self._inertial_places,
            order,
            matrix,
        )
        self._drives(matrix, dq, ddq)
        return matrix

    @cached_property
    def _frames(self) -> LinkFrames:
        return link_frames(self.robot)

    @cached_property
    def _inertial_places(self) -> IntArray:
        """Columns (n_joints, 10) of the inertial parameters, links in tree order; -1: none."""
        places = np.full((len(self.robot.order), 10), -1, dtype=np.int64)
        for column, parameter in enumerate(self.layout.parameters):
            if parameter.kind in INERTIAL:
                places[parameter.joint, REGRESSOR_ORDER[INERTIAL.index(parameter.kind)]] = column
        return places[self.robot.order]

    def _drives(self, matrix: FloatArray, dq: FloatArray, ddq: FloatArray) -> None:
        sign = np.sign(dq)
        pairs = {pair[1]: pair[0] for pair in self.layout.coupling_joints}
        for column, parameter in enumerate(self.layout.parameters):
            joint, kind = parameter.joint, parameter.kind
            if kind == "Ia":
                matrix[:, joint, column] = ddq[:, joint]
                if joint in pairs:
                    matrix[:, joint, column] += ddq[:, pairs[joint]]
                    matrix[:, pairs[joint], column] = ddq[:, joint]
            elif kind == "Fv":
                matrix[:, joint, column] = dq[:, joint]
            elif kind == "Fc":
                matrix[:, joint, column] = sign[:, joint]
            elif kind == "off":
                matrix[:, joint, column] = 1.0
            elif kind == "Fvm":
                matrix[:, pairs[joint], column] = dq[:, joint]
                matrix[:, joint, column] = dq[:, pairs[joint]]
            elif kind == "Fcm":
                coupled = np.sign(dq[:, pairs[joint]] + dq[:, joint])
                matrix[:, pairs[joint], column] = coupled
                matrix[:, joint, column] = coupled
