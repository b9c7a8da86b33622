"""What the physical bounds cost: the torque that estimate and consistent set leave unexplained."""

from collections.abc import Callable, Sequence

import numpy as np

from idim_iv_ros.errors import DataError
from idim_iv_ros.estimation.least_squares import solve_instrumental_variables
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.physical.result import TorqueError
from idim_iv_ros.types import FloatArray

_PARTS = 4
Projection = Callable[[FloatArray], FloatArray]


class Judge:
    """Errors of the torque on all rows, and on quarters that were left out of the fit.

    Each quarter is reduced once: R factors of three make the fit, that of the fourth judges it.

    - `rows`: of all joints; with instruments, held-out estimates use them
    - `parameters`: b
    - `sigma`: (n_joints,), standard deviation of each joint's residual: the weights
    """

    def __init__(self, rows: Sequence[JointRows], parameters: int, sigma: FloatArray):
        self._parameters, self._sigma = parameters, sigma
        ends = [np.linspace(0, len(joint.torque), _PARTS + 1).astype(np.int64) for joint in rows]
        self._parts = [
            [
                joint.part(slice(*end[k : k + 2])).reduced
                for joint, end in zip(rows, ends, strict=True)
            ]
            for k in range(_PARTS)
        ]

    def __call__(
        self, projection: Projection, estimate: FloatArray, consistent: FloatArray
    ) -> TorqueError:
        """Judge β̂ (b,) and the set that `projection` makes of it (b,)."""
        whole = self._error([estimate] * _PARTS), self._error([consistent] * _PARTS)
        estimates = []
        for left_out in range(_PARTS):
            others = [part for k, part in enumerate(self._parts) if k != left_out]
            rows = [first.joined(more) for first, *more in zip(*others, strict=True)]
            try:
                linear = solve_instrumental_variables(rows, self._parameters, self._sigma)
            except (DataError, np.linalg.LinAlgError):  # a quarter is indispensable
                return TorqueError(*whole, None, None)
            estimates.append(linear.values)
        projected = [projection(values) for values in estimates]
        return TorqueError(*whole, self._error(estimates), self._error(projected))

    def _error(self, estimates: Sequence[FloatArray]) -> float:
        """Relative torque error, %, over all quarters, with an estimate for every quarter."""
        error = torque = 0.0
        for part, values in zip(self._parts, estimates, strict=True):
            for rows, sigma in zip(part, self._sigma, strict=True):
                error += float(np.sum(rows.residual(values) ** 2)) / sigma**2
                torque += float(np.sum(rows.torque**2)) / sigma**2
        return 100.0 * float(np.sqrt(error / torque)) if torque > 0.0 else float("nan")
