"""IDIM-IV: instruments simulated at the last estimate, until nothing moves (section III).

Refined IDIM-IV filters y, X and Z by the inverse of the residual's shaping filter (equation 12).
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.errors import DataError
from idim_iv_ros.estimation.instruments import Instruments, InstrumentSource, SourceFailure, Start
from idim_iv_ros.estimation.least_squares import (
    LinearEstimate,
    refined_covariance,
    restrict,
    solve_instrumental_variables,
    solve_least_squares,
    white_covariance,
)
from idim_iv_ros.estimation.rows import JointRows, with_instruments
from idim_iv_ros.signals.autoregression import AutoregressiveModel
from idim_iv_ros.types import FloatArray

# Parameters with a relative deviation above this do not decide about convergence.
_LARGEST_DEVIATION = 0.3
# Of their size, within which given values are taken as right where an estimate cannot be simulated.
_SPREADS = (1.0, 0.3, 0.1, 0.03, 0.01)


@dataclass(frozen=True)
class IdimIvEstimate:
    """Outcome of the IDIM-IV iteration.

    - `least_squares`: joint-weighted IDIM-LS on the same rows, from which the weights come
    - `steps`: of each iteration the largest relative change of a precise parameter, and which
    - `failures`: sources of instruments that were tried and why they failed
    """

    linear: LinearEstimate
    least_squares: LinearEstimate
    source: InstrumentSource
    instruments: Instruments
    steps: tuple[tuple[float, int], ...]
    converged: bool
    failures: tuple[str, ...]


def idim_iv(
    rows: Sequence[JointRows],
    sources: Sequence[InstrumentSource],
    starts: Sequence[Start],
    *,
    tolerance: float = 0.01,
    max_iterations: int = 10,
    progress: Callable[[str, float], None] | None = None,
) -> IdimIvEstimate:
    """Iterate equations 7 to 9 until the precise parameters stop moving.

    The sources are tried in order, each from the starts in order: when the simulation diverges,
    the next takes over and the reason is kept.

    `starts`: possible first simulations; `tolerance`: largest relative change of a parameter
    between the last two estimates.

    Raises DataError: no source can make instruments, or there are too few rows.
    """
    least_squares = solve_least_squares(rows, len(starts[0].values))
    failures: list[str] = []
    for source in sources:
        for start in starts:
            settings = tolerance, max_iterations, progress
            try:
                return _Iteration(rows, source, start, least_squares, *settings).run(failures)
            except SourceFailure as failure:
                where = f" from {start.name}" if source.iterative else ""
                failures.append(f"{source.name}{where}: {failure}")
            if not source.iterative:
                break
    raise DataError("no instruments: " + "; ".join(failures))


@dataclass(frozen=True)
class _Iteration:
    rows: Sequence[JointRows]
    source: InstrumentSource
    start: Start
    least_squares: LinearEstimate
    tolerance: float
    max_iterations: int
    progress: Callable[[str, float], None] | None

    def run(self, failures: Sequence[str]) -> IdimIvEstimate:
        values = self.start.values
        if self.start.spread is None:
            instruments = self.source.instruments(values, self.least_squares.values)
        else:
            instruments = self._as_it_is_or_scaled(values)
        linear = self._solve(instruments, self.least_squares.sigma)
        steps: list[tuple[float, int]] = []
        converged = not self.source.iterative
        while not converged and (done := len(steps) + 1) < self.max_iterations:
            if self.progress is not None:
                self.progress(f"IDIM-IV iteration {done + 1}", done / self.max_iterations)
            instruments = self._simulate(linear)
            before, linear = linear, self._solve(instruments, linear.sigma)
            steps.append(self._change(before.values, linear))
            converged = steps[-1][0] <= self.tolerance
        return IdimIvEstimate(
            linear,
            self.least_squares,
            self.source,
            instruments,
            tuple(steps),
            converged,
            tuple(failures),
        )

    def _as_it_is_or_scaled(self, values: FloatArray) -> Instruments:
        """Scale the gains only where the loop diverges.

        Least squares, which says by how much, may be further from the robot than the values are.
        """
        try:
            return self.source.instruments(values, values)
        except SourceFailure:
            return self.source.instruments(values, self.least_squares.values)

    def _simulate(self, linear: LinearEstimate) -> Instruments:
        """Simulate at the estimate, or where that diverges as near to it as can be."""
        try:
            return self._as_it_is_or_scaled(linear.values)
        except SourceFailure as failure:
            for values, where in self._nearby(linear):
                try:
                    instruments = self._as_it_is_or_scaled(values)
                except SourceFailure:
                    continue
                note = f"simulated {where}, because {failure}"
                note = f"{instruments.note}; {note}".lstrip("; ")
                reason = f"the loop could not be simulated at the estimate ({failure})"
                return replace(instruments, note=note, untestable=reason)
            raise

    def _nearby(self, linear: LinearEstimate) -> Iterator[tuple[FloatArray, str]]:
        """Parameters that stand in for an estimate that cannot be simulated, and what they are.

        With given values, the estimate is combined with them as with a measurement that is trusted
        more and more. Without, the poorly known parameters are put to zero.
        """
        covariance = white_covariance(self.rows, linear.sigma, len(linear.values))
        given, spread = self.start.values, self.start.spread
        if spread is not None:
            information = np.linalg.inv(covariance)
            for share in _SPREADS:
                prior = np.diag(1.0 / (share * spread) ** 2)
                pull = np.linalg.solve(information + prior, prior @ (given - linear.values))
                where = f"{100 * share:g} % of their size"
                yield linear.values + pull, f"with given values taken as right within {where}"
            return
        deviation = np.sqrt(np.diag(covariance))
        precise = np.flatnonzero(deviation <= _LARGEST_DEVIATION * np.abs(linear.values))
        if 0 < len(precise) < len(linear.values):
            values = np.zeros(len(linear.values))
            values[precise], _ = restrict(linear.values, covariance, precise.tolist())
            yield values, f"with the {len(precise)} precise parameters only"

    def _solve(self, instruments: Instruments, sigma: FloatArray) -> LinearEstimate:
        parameters = len(self.least_squares.values)
        rows = with_instruments(self.rows, instruments.matrices)
        try:
            linear = solve_instrumental_variables(rows, parameters, sigma)
            # Once more, so that the weights are those of the IV residual.
            return solve_instrumental_variables(rows, parameters, linear.sigma)
        except DataError as error:
            raise SourceFailure(str(error)) from error

    def _change(self, previous: FloatArray, linear: LinearEstimate) -> tuple[float, int]:
        """Largest relative change of a precise parameter, and the place of that parameter."""
        covariance = white_covariance(self.rows, linear.sigma, len(linear.values))
        deviation = np.sqrt(np.diag(covariance))
        precise = deviation <= _LARGEST_DEVIATION * np.abs(linear.values)
        if not precise.any():
            precise[:] = True
        size = np.maximum(np.abs(previous), 1e-12)
        change = np.where(precise, np.abs(linear.values - previous) / size, 0.0)
        worst = int(np.argmax(change))
        return float(change[worst]), worst


def refined_idim_iv(
    rows: Sequence[JointRows], models: Sequence[AutoregressiveModel], parameters: int
) -> tuple[FloatArray, FloatArray]:
    """β̂ᶠ = (ZfᵀXf)⁻¹ Zfᵀyf and Σ = σ̂²(ZfᵀZf)⁻¹, with the filter and σ of every joint.

    With the observation matrices as instruments it is the refined IDIM-LS. The filtered rows of
    a joint are reduced and forgotten. `models`: Ĉ(z⁻¹), fitted on the unfiltered IV residual.

    Returns the estimate (b,) and its covariance (b, b).
    """
    filtered = [joint.whitened(model).reduced for joint, model in zip(rows, models, strict=True)]
    sigma = np.sqrt([max(model.innovation_variance, 1e-300) for model in models])
    for _ in range(2):
        linear = solve_instrumental_variables(filtered, parameters, sigma)
        sigma = linear.sigma
    return linear.values, refined_covariance(filtered, sigma, parameters)
