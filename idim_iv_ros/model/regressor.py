"""Regressor of the inverse dynamic model (paper, equation 3)."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from idim_iv_ros.model.parameters import INERTIAL, REGRESSOR_ORDER, ParameterLayout
from idim_iv_ros.model.robot import RobotModel

FloatArray = NDArray[np.float64]


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
        columns, inertial = self._inertial_columns
        matrix[:, :, columns] = self._inertial(q, dq, ddq)[:, :, inertial]
        self._drives(matrix, dq, ddq)
        return matrix

    @cached_property
    def _inertial_columns(self) -> tuple[list[int], list[int]]:
        """Places of the inertial parameters in the layout, and in pinocchio's regressor."""
        places = [
            (column, 10 * parameter.joint + REGRESSOR_ORDER[INERTIAL.index(parameter.kind)])
            for column, parameter in enumerate(self.layout.parameters)
            if parameter.kind in INERTIAL
        ]
        return [column for column, _ in places], [place for _, place in places]

    def _inertial(self, q: FloatArray, dq: FloatArray, ddq: FloatArray) -> FloatArray:
        robot = self.robot
        model, data, order = robot.pinocchio, robot.pinocchio.createData(), robot.order
        regressor = pin.computeJointTorqueRegressor
        tree_q = np.ascontiguousarray(q[:, order])
        tree_dq = np.ascontiguousarray(dq[:, order])
        tree_ddq = np.ascontiguousarray(ddq[:, order])
        tree = np.empty((len(q), len(order), 10 * len(order)))
        for sample in range(len(q)):
            tree[sample] = regressor(model, data, tree_q[sample], tree_dq[sample], tree_ddq[sample])
        if np.array_equal(order, np.arange(len(order))):
            return tree
        place = np.argsort(order)
        columns = (10 * place[:, None] + np.arange(10)).ravel()
        return tree[:, place][:, :, columns]

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
