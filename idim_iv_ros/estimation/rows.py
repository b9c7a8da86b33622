"""The rows of one joint's regression: the one type that estimators, tests and diagnosis share."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from idim_iv_ros.estimation.qr import BLOCK, r_factor, streamed_r_factor
from idim_iv_ros.signals.autoregression import AutoregressiveModel, Segments
from idim_iv_ros.types import FloatArray, IntArray

# Noise over torque of rows that are left out: enough to lose all weight, and no column.
_LEFT_OUT = 100.0


@dataclass(frozen=True, eq=False)
class JointRows:
    """Rows of a joint of y = X β + ε and, where there are instruments, of X = Z Π + V.

    `matrix`: (r, c), regressor X: only the columns that are not structurally zero for this joint.
    `torque`: (r,) N m (N for a prismatic joint), y. `columns`: (c,) int, places of these columns
    among all b parameters. `segments`: rows that are contiguous in time, covering all of them in
    order. `position`: (r,) int, place of each row on the uniform decimated grid; recordings lie far
    apart. `instrument_matrix`: (r, c), Z; None where X is its own instrument. `represented`: how
    many rows were reduced to these by QR; None where these are the rows themselves. `left_out`:
    whether the torque says nothing of the robot: its rows get next to no weight.
    """

    matrix: FloatArray
    torque: FloatArray
    columns: IntArray
    segments: tuple[slice, ...] = ()
    name: str = ""
    position: IntArray | None = None
    instrument_matrix: FloatArray | None = None
    represented: int | None = None
    left_out: bool = False

    def __len__(self) -> int:
        """How many rows these are or, reduced, stand for."""
        return len(self.torque) if self.represented is None else self.represented

    @property
    def assumed_sigma(self) -> float | None:
        """Noise of a torque that says nothing of the robot, N m (N); None of any other."""
        if not self.left_out:
            return None
        rms = float(np.linalg.norm(self.torque) / np.sqrt(max(len(self), 1)))
        return _LEFT_OUT * max(rms, 1e-300)

    @property
    def instruments(self) -> FloatArray:
        """Instruments Z (r, c); the regressor X where it is its own instrument."""
        return self.matrix if self.instrument_matrix is None else self.instrument_matrix

    @property
    def places(self) -> IntArray:
        """(c + 1,) places of the columns of `r_factor`; the torque is the last, −1."""
        return np.append(self.columns, -1)

    def prediction(self, parameters: FloatArray) -> FloatArray:
        """(r,) X β: the torque predicted with the measured motion; `parameters` (b,)."""
        return self.matrix @ parameters[self.columns]

    def residual(self, parameters: FloatArray) -> FloatArray:
        """Residual y − X β (r,) at base parameters (b,)."""
        return self.torque - self.prediction(parameters)

    def with_instruments(self, matrix: FloatArray | None) -> "JointRows":
        """Return the rows with other instruments Z (r, c); None: X is its own instrument."""
        return replace(self, instrument_matrix=matrix)

    def whitened(self, model: AutoregressiveModel) -> "JointRows":
        """Return the rows with y, X and Z filtered by Ĉ(z⁻¹), the prediction error of `model`."""
        return self._of(model.whiten(self._table(slice(None)), self.segments))

    def with_columns(self, columns: FloatArray, places: IntArray) -> "JointRows":
        """Return the same rows with more columns (r, k) at these places."""
        matrix = np.hstack([self.matrix, columns])
        return replace(self, matrix=matrix, columns=np.concatenate([self.columns, places]))

    def keep(self, parameters: IntArray) -> "JointRows":
        """Return the same rows with only some base parameters, renumbered in their order."""
        inside = np.isin(self.columns, parameters)
        z = self.instrument_matrix
        return replace(
            self,
            matrix=self.matrix[:, inside],
            columns=np.searchsorted(parameters, self.columns[inside]),
            instrument_matrix=None if z is None else z[:, inside],
        )

    def part(self, rows: slice) -> "JointRows":
        """Return some of these rows, without their places in time."""
        return replace(self._of(self._table(rows)), segments=(), position=None)

    def joined(self, others: Sequence["JointRows"]) -> "JointRows":
        """Return these rows and others of the joint, one below the other."""
        parts = [self, *others]
        starts = np.cumsum([0, *(len(part.torque) for part in parts)]).tolist()
        return replace(
            self._of(np.vstack([part._table(slice(None)) for part in parts])),
            segments=Segments(
                slice(start + run.start, start + run.stop)
                for part, start in zip(parts, starts, strict=False)
                for run in part.segments
            ),
            position=None,
            represented=sum(map(len, parts)),
            left_out=any(part.left_out for part in parts),
        )

    @cached_property
    def reduced(self) -> "JointRows":
        """The R factor of [Z X y]: it replaces these rows where their order does not matter."""
        starts = range(0, max(len(self.torque), 1), BLOCK)
        blocks = (self._table(slice(start, start + BLOCK)) for start in starts)
        width = self._table(slice(0)).shape[1]
        rows = self._of(streamed_r_factor(blocks, width))
        return replace(rows, segments=(), position=None, represented=len(self))

    @cached_property
    def r_factor(self) -> FloatArray:
        """Upper triangle R (≤ c + 1, c + 1) of the QR decomposition of [X y]."""
        rows = self if self.instrument_matrix is None else self.with_instruments(None)
        reduced = rows.reduced
        return np.column_stack([reduced.matrix, reduced.torque])

    @property
    def instrumental_r_factor(self) -> FloatArray:
        """Upper triangle R (≤ 2c + 1, 2c + 1) of the QR decomposition of [Z X y]."""
        reduced = self.reduced
        return np.column_stack([reduced.instruments, reduced.matrix, reduced.torque])

    def standardized_r_factor(self, noise: AutoregressiveModel) -> FloatArray:
        """R factor of [X y] whitened to unit variance."""
        # Contiguous columns: they are filtered one by one.
        columns = np.asfortranarray(np.column_stack([self.matrix, self.torque]))
        return r_factor(noise.standardized(columns, self.segments))

    def _table(self, rows: slice) -> FloatArray:
        """Columns of some rows, to be filtered or reduced together: [Z X y], [X y] where Z is X."""
        z = [] if self.instrument_matrix is None else [self.instrument_matrix[rows]]
        return np.column_stack([*z, self.matrix[rows], self.torque[rows]])

    def _of(self, table: FloatArray) -> "JointRows":
        """Return rows of this joint made of columns in the order of `_table`."""
        width = len(self.columns)
        z = None if self.instrument_matrix is None else table[:, :width]
        matrix, torque = table[:, -width - 1 : -1], table[:, -1]
        return replace(self, matrix=matrix, torque=torque, instrument_matrix=z)


def with_instruments(
    rows: Sequence[JointRows], matrices: Sequence[FloatArray]
) -> tuple[JointRows, ...]:
    """Rows of all joints with the instruments Z of each."""
    return tuple(joint.with_instruments(z) for joint, z in zip(rows, matrices, strict=True))
