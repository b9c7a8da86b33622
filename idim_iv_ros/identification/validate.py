"""Tests and residual analysis of one estimate, on rows no denser than the loop is fast."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.estimation.idim_iv import IdimIvEstimate
from idim_iv_ros.estimation.instruments import Instruments, SimulatedLoop, SourceFailure
from idim_iv_ros.estimation.least_squares import LinearEstimate, white_covariance
from idim_iv_ros.estimation.observation import CHUNK, observation_rows
from idim_iv_ros.estimation.rows import JointRows, with_instruments
from idim_iv_ros.identification.prepare import PreparedRegression
from idim_iv_ros.signals.autoregression import AutoregressiveModel
from idim_iv_ros.signals.motion import Motion, decimated_motion, torque_noise
from idim_iv_ros.statistics import instruments as instrument_tests
from idim_iv_ros.statistics.hypothesis import HypothesisTest
from idim_iv_ros.statistics.residuals import ResidualDiagnosis, diagnose_residual
from idim_iv_ros.statistics.specification import (
    SPEED,
    shared_functions,
    specification_tests,
    speed_functions,
    tests_not_run,
)
from idim_iv_ros.types import FloatArray

# A residual of up to this many times the measurement noise passes for noise when the uncertainty
# of the simulation's parameters is judged; what is beyond that is the model's own error.
_LARGEST_NOISE = 3.0

# The paper decimates at twice the bandwidth of its loops (section V.B).
_TIMES_THE_LOOP = 2.0
# Rows up to this many times denser than that are tested as they are.
_DENSER = 2.0
# Rows of a recording below which there is nothing to test.
_FEWEST = 10


@dataclass(frozen=True)
class Validation:
    """What the tests say of one estimate; `specification` has one group of tests a joint."""

    tests: tuple[HypothesisTest, ...]
    exogeneity: tuple[HypothesisTest, ...]
    specification: tuple[tuple[HypothesisTest, ...], ...]
    residuals: tuple[ResidualDiagnosis, ...]
    note: str

    @property
    def models(self) -> list[AutoregressiveModel]:
        """Autoregressive models of the residuals of the joints."""
        models = (residual.autoregression for residual in self.residuals)
        return [model for model in models if model is not None]


def validate(
    prepared: PreparedRegression,
    observed: Sequence[JointRows],
    linear: LinearEstimate,
    estimate: IdimIvEstimate | None,
) -> Validation:
    """Run the revised Durbin-Wu-Hausman test and the residual analysis (paper, section IV).

    `observed`: the rows that count, with the instruments of the estimate; `linear`: the estimate
    that is judged; `estimate`: the IDIM-IV iteration, None for IDIM-LS.
    """
    alpha = prepared.configuration.identification.significance
    values, names = linear.values, [joint.name for joint in observed]
    residuals = tuple(diagnose_residual(joint, values, alpha=alpha) for joint in observed)
    untested = "IDIM-LS uses no instruments"
    if estimate is not None:
        untested = estimate.source.untestable or estimate.instruments.untestable or ""
    if estimate is None or untested:
        tests, exogeneity = (
            tuple(HypothesisTest.not_run(null, scope, untested) for scope in ("all", *names))
            for null in (instrument_tests.VALID, instrument_tests.EXOGENOUS)
        )
        specification = tuple(tests_not_run(name, untested, alpha) for name in names)
        tests, exogeneity = _together(tests, alpha), _together(exogeneity, alpha)
        return Validation(tests, exogeneity, specification, residuals, "")
    source, rows, instruments, note = _tested(prepared, observed, estimate)
    noise = np.minimum(linear.sigma, _LARGEST_NOISE * torque_noise(prepared.motions))
    observed_alone = [joint.with_instruments(None) for joint in observed]
    errors = source.prediction_errors(values, white_covariance(observed_alone, noise, len(values)))
    candidates = functions_of_motion(source.motions, instruments, prepared.model.robot.joint_types)
    return Validation(
        _together(instrument_tests.wald_test_of_instruments(rows, values, errors), alpha),
        _together(instrument_tests.exogeneity_test(rows, values), alpha),
        specification_tests(rows, values, candidates, alpha=alpha),
        residuals,
        note,
    )


def _together(tests: tuple[HypothesisTest, ...], alpha: float) -> tuple[HypothesisTest, ...]:
    """Share α: half for all rows, half among the n joints (Bonferroni).

    A right model is then accused anywhere with probability α at most.
    """
    first, *others = tests
    shared = (replace(test, alpha=alpha / (2.0 * len(others))) for test in others)
    return (replace(first, alpha=alpha / 2.0), *shared)


def _tested(
    prepared: PreparedRegression, observed: Sequence[JointRows], estimate: IdimIvEstimate
) -> tuple[SimulatedLoop, tuple[JointRows, ...], Instruments, str]:
    """Choose the rows for the tests of the instruments and of the specification.

    Where the rows of the estimate are more than twice as dense as twice the natural frequency of
    the fastest loop asks for, new ones are made at that rate. Whitening filters of a hundred
    coefficients cannot resolve the few hertz in which the motion lives when the rows reach to
    hundreds: a right model was then rejected at p < 1e-10.

    Returns the loop that makes the instruments, rows with these, and what was done in words.
    """
    source, values = estimate.source, estimate.linear.values
    assert isinstance(source, SimulatedLoop)  # no other source can be tested
    as_it_is = source, tuple(observed), estimate.instruments, ""
    wanted = _TIMES_THE_LOOP * source.natural_frequency(values)
    cutoff = prepared.cutoffs.decimation
    if wanted <= 0.0 or cutoff < _DENSER * wanted:
        return as_it_is
    times = int(cutoff / wanted)
    decimations = [motion.decimation for motion in prepared.motions]
    if any(of.factor * times * _FEWEST > of.samples for of in decimations):
        return as_it_is  # gains so low that the loop takes longer than the recording
    motions = tuple(
        decimated_motion(
            motion.signals,
            motion.position,
            motion.span,
            prepared.configuration.processing,
            (motion.cutoff, motion.decimation.factor * times),
            prepared.minimum_speed,
            prepared.model.regressor.layout.coupling_joints,
        )
        for motion in prepared.motions
    )
    slower = replace(source, motions=motions)
    try:
        instruments = slower.instruments(values, values)
    except SourceFailure:
        return as_it_is
    row_rate, natural = prepared.cutoffs.row_rate / times, wanted / _TIMES_THE_LOOP
    note = (
        f"tested on {row_rate:.3g} rows per second: the fastest loop has a natural frequency of "
        f"{natural:.3g} Hz, and denser rows say nothing more"
    )
    rows = with_instruments(observation_rows(prepared.model, motions), instruments.matrices)
    return slower, rows, instruments, note


def functions_of_motion(
    motions: Sequence[Motion], instruments: Instruments, joint_types: Sequence[str]
) -> list[dict[str, FloatArray]]:
    """Functions of the simulated motion at the tested rows, one mapping for each joint.

    Family to (r_j, m); see `statistics.specification`. Decimated as the regressor is.
    """
    joints = range(len(joint_types))
    speeds = [
        np.abs(np.diff(motion.position[motion.span], axis=0)).max(axis=0) * motion.signals.rate
        for motion in motions
    ]
    peaks = np.maximum(np.max(speeds, axis=0), np.finfo(float).tiny)  # it divides
    parts: list[dict[str, list[FloatArray]]] = [{} for _ in joints]
    for motion, states in zip(motions, instruments.states, strict=True):
        for chunk in motion.decimation.chunks(CHUNK):
            kept = motion.kept[chunk.places]
            q, dq, ddq = states(chunk.first, chunk.last)
            shared = {
                family: motion.decimation.apply(functions, chunk)
                for family, functions in shared_functions(joint_types, q, dq, ddq).items()
            }
            for joint in joints:
                of_speed = motion.decimation.apply(speed_functions(joint, dq, peaks[joint]), chunk)
                for family, functions in {**shared, SPEED: of_speed}.items():
                    parts[joint].setdefault(family, []).append(functions[kept[:, joint]])
    return [{family: np.concatenate(blocks) for family, blocks in part.items()} for part in parts]
