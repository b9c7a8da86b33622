"""Tests and residual analysis of one estimate, on rows no denser than the loop is fast."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from idim_iv_ros.estimation.covariance import WhiteCovariance
from idim_iv_ros.estimation.idim_iv import IdimIvEstimate
from idim_iv_ros.estimation.instruments import (
    Instruments,
    InstrumentSource,
    SimulatedLoop,
    SourceFailure,
)
from idim_iv_ros.estimation.least_squares import LinearEstimate
from idim_iv_ros.estimation.observation import CHUNK, observation_rows
from idim_iv_ros.estimation.rows import JointRows, with_instruments
from idim_iv_ros.identification.prepare import PreparedRegression
from idim_iv_ros.signals import AutoregressiveModel, Motion, coarser, torque_noise
from idim_iv_ros.statistics import (
    HypothesisTest,
    ResidualDiagnosis,
    diagnose_residual,
    exogeneity_test,
    specification_tests,
    wald_test_of_instruments,
)
from idim_iv_ros.statistics.specification import (
    FAMILIES,
    SPEED,
    shared_functions,
    speed_functions,
)
from idim_iv_ros.types import FloatArray

# A residual of up to this many times the measurement noise passes for noise when the uncertainty
# of the simulation's parameters is judged; what is beyond that is the model's own error.
_LARGEST_NOISE = 3.0

NO_INSTRUMENTS = "IDIM-LS uses no instruments"
# The paper decimates at twice the bandwidth of its loops (section V.B).
_TIMES_THE_LOOP = 2.0
# Rows up to this many times denser than that are tested as they are.
_DENSER = 2.0
# Rows of a recording below which there is nothing to test.
_FEWEST = 10


@dataclass(frozen=True)
class Validation:
    """What the tests say of one estimate; see `IdentificationResult` for its parts.

    `specification` has one group of tests for each joint.
    """

    tests: tuple[HypothesisTest, ...]
    exogeneity: tuple[HypothesisTest, ...]
    specification: tuple[tuple[HypothesisTest, ...], ...]
    residuals: tuple[ResidualDiagnosis, ...]
    models: tuple[AutoregressiveModel, ...]
    note: str


def validate(
    prepared: PreparedRegression,
    observed: Sequence[JointRows],
    linear: LinearEstimate,
    estimate: IdimIvEstimate | None,
) -> Validation:
    """Run the revised Durbin-Wu-Hausman test and the residual analysis (paper, section IV).

    Parameters
    ----------
    observed
        The rows that count, with the instruments of the estimate.
    linear
        The estimate that is judged.
    estimate
        The IDIM-IV iteration, None for IDIM-LS.
    """
    configuration = prepared.configuration
    alpha = configuration.identification.significance
    joints = configuration.robot.joints
    rows: Sequence[JointRows] = observed
    residuals = tuple(diagnose_residual(joint, linear.values, alpha=alpha) for joint in rows)
    reason: str | None = NO_INSTRUMENTS
    if estimate is not None:
        reason = estimate.source.testable or estimate.instruments.untestable
    errors, candidates, note = None, _no_functions(len(joints)), ""
    if estimate is not None and reason is None:
        tested = tested_rows(prepared, observed, estimate)
        rows = with_instruments(tested.rows, tested.instruments.matrices)
        noise = np.minimum(linear.sigma, _LARGEST_NOISE * torque_noise(prepared.motions))
        own = [joint.with_instruments(joint.matrix) for joint in observed]
        covariance = WhiteCovariance(own, noise, len(linear.values)).matrix
        errors = tested.source.prediction_errors(linear.values, covariance)
        candidates = functions_of_motion(tested, prepared.model.robot.joint_types)
        note = tested.note
    tests = wald_test_of_instruments(
        rows, linear.values, alpha=alpha, not_simulated=reason, simulation_errors=errors
    )
    exogeneity = exogeneity_test(rows, linear.values, alpha=alpha, not_simulated=reason)
    specification = iter(
        specification_tests(rows, linear.values, candidates, alpha=alpha, not_simulated=reason)
    )
    return Validation(
        tests=_together(tests),
        exogeneity=_together(exogeneity),
        specification=tuple(
            tuple(islice(specification, len(candidate))) for candidate in candidates
        ),
        residuals=residuals,
        models=tuple(residual.autoregression for residual in residuals),
        note=note,
    )


def _no_functions(joints: int) -> list[dict[str, FloatArray]]:
    return [{family: np.zeros((0, 0)) for family in FAMILIES} for _ in range(joints)]


def _together(tests: tuple[HypothesisTest, ...]) -> tuple[HypothesisTest, ...]:
    """Share α: half for all rows, half among the n joints (Bonferroni).

    A right model is then accused anywhere with probability α at most.
    """
    joints = max(len(tests) - 1, 1)
    first, others = tests[0], tests[1:]
    return (
        replace(first, alpha=first.alpha / 2.0),
        *(replace(test, alpha=test.alpha / (2.0 * joints)) for test in others),
    )


@dataclass(frozen=True)
class TestedRows:
    """Rows, their instruments, and the simulated motion behind these.

    Attributes
    ----------
    motions : tuple of Motion
    rows : tuple of JointRows
    instruments : Instruments
    source : InstrumentSource
        Makes instruments for these motions.
    note : str
        What was done to the rows, in words; empty when nothing was.
    """

    __test__ = False  # no class of tests, whatever its name

    motions: tuple[Motion, ...]
    rows: tuple[JointRows, ...]
    instruments: Instruments
    source: InstrumentSource
    note: str


def tested_rows(
    prepared: PreparedRegression, observed: Sequence[JointRows], estimate: IdimIvEstimate
) -> TestedRows:
    """Choose the rows for the tests of the instruments and of the specification.

    Where the rows of the estimate are more than twice as dense as twice the natural frequency of
    the fastest loop asks for, new ones are made at that rate. Whitening filters of a hundred
    coefficients cannot resolve the few hertz in which the motion lives when the rows reach to
    hundreds: a right model was then rejected at p < 1e-10.
    """
    as_it_is = TestedRows(
        prepared.motions, tuple(observed), estimate.instruments, estimate.source, ""
    )
    source, values = estimate.source, estimate.linear.values
    if not isinstance(source, SimulatedLoop):
        return as_it_is
    wanted = _TIMES_THE_LOOP * source.natural_frequency(values)
    cutoff = prepared.cutoffs.decimation
    if wanted <= 0.0 or cutoff < _DENSER * wanted:
        return as_it_is
    times = int(cutoff / wanted)
    if any(
        motion.decimation.factor * times * _FEWEST > motion.decimation.samples
        for motion in prepared.motions
    ):
        return as_it_is  # gains so low that the loop takes longer than the recording
    couplings = prepared.model.regressor.layout.coupling_joints
    motions = tuple(
        coarser(
            motion,
            motion.decimation.factor * times,
            prepared.configuration.processing,
            prepared.minimum_speed,
            couplings,
        )
        for motion in prepared.motions
    )
    slower = replace(source, motions=motions)
    try:
        instruments = slower.instruments(values, values)
    except SourceFailure:
        return as_it_is
    note = (
        f"tested on {prepared.cutoffs.row_rate / times:.3g} rows per second: the fastest loop has "
        "a natural frequency of "
        f"{wanted / _TIMES_THE_LOOP:.3g} Hz, and denser rows say nothing more"
    )
    rows = observation_rows(prepared.model, motions)
    return TestedRows(motions, rows, instruments, slower, note)


def functions_of_motion(
    tested: TestedRows, joint_types: Sequence[str]
) -> list[dict[str, FloatArray]]:
    """Functions of the simulated motion at the tested rows, one mapping for each joint.

    Family to (r_j, m); see `motion_functions`. Decimated as every column of the regressor is.
    """
    joints = range(len(joint_types))
    peaks = _peak_speeds(tested.motions)
    parts: list[dict[str, list[FloatArray]]] = [{} for _ in joints]
    for motion, states in zip(tested.motions, tested.instruments.states, strict=True):
        done = 0
        for chunk in motion.decimation.chunks(CHUNK):
            kept = motion.kept[done : done + len(chunk.kept)]
            q, dq, ddq = states(chunk.first, chunk.last)
            shared = {
                family: motion.decimation.apply(functions, chunk)
                for family, functions in shared_functions(joint_types, q, dq, ddq).items()
            }
            for joint in joints:
                own = motion.decimation.apply(speed_functions(joint, dq, peaks[joint]), chunk)
                for family, functions in {**shared, SPEED: own}.items():
                    parts[joint].setdefault(family, []).append(functions[kept[:, joint]])
            done += len(chunk.kept)
    return [{family: np.concatenate(blocks) for family, blocks in part.items()} for part in parts]


def _peak_speeds(motions: Sequence[Motion]) -> FloatArray:
    """Largest filtered speed of each joint, at least the smallest number that divides."""
    peaks = [
        np.abs(np.diff(motion.position[motion.span], axis=0)).max(axis=0) * motion.signals.rate
        for motion in motions
    ]
    return np.asarray(np.maximum(np.max(peaks, axis=0), np.finfo(float).tiny))
