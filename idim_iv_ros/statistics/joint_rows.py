"""The rows of one joint as the tests need them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.signals.autoregression import AutoregressiveModel
from idim_iv_ros.types import FloatArray

IntArray = NDArray[np.integer[Any]]


@dataclass(frozen=True)
class JointRows:
    """One joint's part of y = X β + ε and X = Z Π + V.

    Attributes
    ----------
    joint : str
    regressor, instruments : (r_j, c_j)
        X_j and Z_j: only the columns that are not structurally zero for this joint.
    torque : (r_j,) N m (N for a prismatic joint)
        y_j.
    columns : (c_j,) int
        Places of these columns among all b parameters.
    runs : slices of the rows that are contiguous in time, covering all of them in order.
    """

    joint: str
    regressor: FloatArray
    instruments: FloatArray
    torque: FloatArray
    columns: IntArray
    runs: Sequence[slice]

    def prediction(self, parameters: FloatArray) -> FloatArray:
        """(r_j,) X_j β: the torque predicted with the measured motion; `parameters` (b,)."""
        return self.regressor @ parameters[self.columns]

    def residual(self, parameters: FloatArray) -> FloatArray:
        """(r_j,) y_j − X_j β; `parameters` (b,)."""
        return self.torque - self.prediction(parameters)

    def whitened(self, model: AutoregressiveModel) -> "JointRows":
        """Return the same rows with Ĉ(z⁻¹) applied to y, X and Z alike."""
        width = len(self.columns)
        both = np.column_stack([self.regressor, self.instruments, self.torque])
        white = model.whiten(both, self.runs)
        return JointRows(
            self.joint,
            white[:, :width],
            white[:, width:-1],
            white[:, -1],
            self.columns,
            self.runs,
        )
