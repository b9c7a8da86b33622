"""IDIM-IV: instruments simulated at the last estimate, until nothing moves (section III)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.errors import DataError
from idim_iv_ros.estimation.essential import restrict
from idim_iv_ros.estimation.instruments import Instruments, InstrumentSource, SourceFailure
from idim_iv_ros.estimation.least_squares import (
    LinearEstimate,
    solve_instrumental_variables,
    solve_weighted_least_squares,
)
from idim_iv_ros.estimation.rows import ObservationRows
from idim_iv_ros.estimation.triangles import JointTriangle, triangles_of_rows, white_covariance

FloatArray = NDArray[np.float64]

# Parameters with a relative deviation above this do not decide about convergence.
_WELL_KNOWN = 0.3


@dataclass(frozen=True)
class IterationStep:
    """One pass: largest relative change of a well-known parameter, and which."""

    change: float
    parameter: int


@dataclass(frozen=True)
class IdimIvEstimate:
    """Outcome of the IDIM-IV iteration.

    Attributes
    ----------
    linear : LinearEstimate
        The last estimate and its residuals.
    source : InstrumentSource
        What made the instruments.
    instruments : Instruments
        Those of the last estimate.
    least_squares : LinearEstimate
        Joint-weighted IDIM-LS on the same rows.
    steps : tuple of IterationStep
    converged : bool
    failures : tuple of str
        Sources of instruments that were tried and why they failed.
    """

    linear: LinearEstimate
    source: InstrumentSource
    instruments: Instruments
    least_squares: LinearEstimate
    steps: tuple[IterationStep, ...]
    converged: bool
    failures: tuple[str, ...] = field(default=())


def idim_iv(
    rows: Sequence[ObservationRows],
    sources: Sequence[InstrumentSource],
    starts: Sequence[tuple[str, FloatArray]],
    *,
    tolerance: float = 0.01,
    max_iterations: int = 10,
    progress: Callable[[str, float], None] | None = None,
) -> IdimIvEstimate:
    """Iterate equations 7 to 9 until the well-known parameters stop moving.

    The sources are tried in order, each from the starts in order: when the simulation diverges,
    the next takes over and the reason is kept.

    Parameters
    ----------
    starts
        Name and base parameters (b,) of possible first simulations.
    tolerance
        Largest relative change of a parameter between the last two estimates.

    Raises
    ------
    DataError
        No source can make instruments, or there are too few rows.
    """
    parameters = len(starts[0][1])
    least_squares = solve_weighted_least_squares(rows, parameters)
    triangles = triangles_of_rows(rows)
    failures: list[str] = []
    for source in sources:
        for name, start in starts:
            step = _Iteration(
                rows, triangles, source, least_squares, tolerance, max_iterations, progress
            )
            try:
                return step.run(start, tuple(failures))
            except SourceFailure as failure:
                where = f" from {name}" if source.iterative else ""
                failures.append(f"{source.name}{where}: {failure}")
            if not source.iterative:
                break
    raise DataError("no instruments: " + "; ".join(failures))


@dataclass(frozen=True)
class _Iteration:
    rows: Sequence[ObservationRows]
    triangles: Sequence[JointTriangle]
    source: InstrumentSource
    least_squares: LinearEstimate
    tolerance: float
    max_iterations: int
    progress: Callable[[str, float], None] | None

    def run(self, start: FloatArray, failures: tuple[str, ...]) -> IdimIvEstimate:
        sigma = self.least_squares.sigma
        instruments = self.source.instruments(start, self.least_squares.values)
        linear = self._solve(instruments, sigma)
        steps: list[IterationStep] = []
        converged = not self.source.iterative
        while not converged and len(steps) + 1 < self.max_iterations:
            if self.progress is not None:
                done = len(steps) + 1
                self.progress(f"IDIM-IV iteration {done + 1}", done / self.max_iterations)
            instruments = self._simulate(linear)
            before, linear = linear, self._solve(instruments, linear.sigma)
            steps.append(self._change(before.values, linear))
            converged = steps[-1].change <= self.tolerance
        return IdimIvEstimate(
            linear,
            self.source,
            instruments,
            self.least_squares,
            tuple(steps),
            converged,
            failures,
        )

    def _simulate(self, linear: LinearEstimate) -> Instruments:
        """Simulate at the estimate; if that diverges, with the poorly known parameters at zero."""
        try:
            return self.source.instruments(linear.values, self.least_squares.values)
        except SourceFailure as failure:
            covariance = self._white_covariance(linear)
            deviation = np.sqrt(np.diag(covariance))
            known = np.flatnonzero(deviation <= _WELL_KNOWN * np.abs(linear.values))
            if len(known) in (0, len(linear.values)):
                raise
            values = np.zeros(len(linear.values))
            values[known], _ = restrict(linear.values, covariance, known.tolist())
            instruments = self.source.instruments(values, self.least_squares.values)
            note = f"simulated with the {len(known)} well-known parameters only, because {failure}"
            return replace(instruments, note=f"{instruments.note}; {note}".lstrip("; "))

    def _solve(self, instruments: Instruments, sigma: FloatArray) -> LinearEstimate:
        parameters = len(self.least_squares.values)
        matrices = instruments.matrices
        try:
            linear = solve_instrumental_variables(self.rows, matrices, parameters, sigma)
            # Once more, so that the weights are those of the IV residual.
            return solve_instrumental_variables(self.rows, matrices, parameters, linear.sigma)
        except DataError as error:
            raise SourceFailure(str(error)) from error

    def _change(self, previous: FloatArray, linear: LinearEstimate) -> IterationStep:
        deviation = np.sqrt(np.diag(self._white_covariance(linear)))
        known = deviation <= _WELL_KNOWN * np.abs(linear.values)
        if not known.any():
            known[:] = True
        size = np.maximum(np.abs(previous), 1e-12)
        change = np.where(known, np.abs(linear.values - previous) / size, 0.0)
        worst = int(np.argmax(change))
        return IterationStep(float(change[worst]), worst)

    def _white_covariance(self, linear: LinearEstimate) -> FloatArray:
        return white_covariance(self.triangles, len(linear.values), linear.sigma)
