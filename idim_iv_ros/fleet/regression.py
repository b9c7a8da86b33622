"""Identification of one bag: its estimate, and the R factor for regressions over many bags."""

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from typing import Any

import numpy as np
import scipy

from idim_iv_ros.compilation import one_thread
from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import DataError
from idim_iv_ros.estimation.qr import r_factor, stacked_r_factor
from idim_iv_ros.fleet.result import JointNoise, iso_time
from idim_iv_ros.identification.identify import Identified, assemble_result, identified
from idim_iv_ros.identification.prepare import loss_sentences
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.progress import Stopwatch
from idim_iv_ros.recording.recording import Recording
from idim_iv_ros.signals.motion import torque_noise
from idim_iv_ros.statistics.verdict import Verdict
from idim_iv_ros.types import FloatArray

# Verdicts on an estimate, the worst first: a bag in segments has that of its worst.
_VERDICTS: tuple[Verdict, ...] = ("misspecified", "inconclusive", "autocorrelated", "valid")
# Stamps before this year are no dates: seconds since a controller was switched on.
_FIRST_YEAR = 2000


@dataclass(frozen=True)
class Segment:
    """Identification of one segment of a bag."""

    start: float  # s, on the clock of the bag
    duration: float  # s
    result: IdentificationResult
    r_factor: FloatArray  # (b + 1, b + 1), see `whitened_r_factor`
    rows: dict[str, int]  # behind the R factor, by joint
    floor: FloatArray  # (n_joints,), noise floor of the torque, N m (N)
    checks: tuple[str, ...]


def bag_fields(
    recordings: Iterable[Recording | DataError], configuration: Configuration
) -> dict[str, Any]:
    """Identify the segments of one bag in turn; return the fields of `BagResult` from `time` on.

    A segment that supports no estimate is left out if another one does; else errors of `identify`.
    """
    segments: list[Segment] = []
    errors: list[DataError] = []
    with one_thread():
        for recording in recordings:
            try:
                if isinstance(recording, DataError):
                    raise recording
                segments.append(_segment(recording, configuration))
            except DataError as error:
                errors.append(error)
    if not segments:
        raise errors[0] if errors else DataError("the bag holds no recording")
    return _join(segments, [f"a segment is left out: {error}" for error in errors])


def _segment(recording: Recording, configuration: Configuration) -> Segment:
    identification = identified([recording], configuration, "idim-iv", Stopwatch(None))
    result = assemble_result(identification)
    return Segment(
        recording.start,
        recording.duration,
        replace(result, series=()),
        whitened_r_factor(identification),
        {joint.name: len(joint) for joint in identification.rows},
        torque_noise(identification.prepared.motions),
        loss_sentences([recording]),
    )


def whitened_r_factor(identification: Identified) -> FloatArray:
    """Return R (b + 1, b + 1) of [X y], each joint whitened by the model of its residual.

    The whitened residual has unit variance: rows of joints and bags have the right weight. The
    diagonal is not negative, so that equal rows have equal factors.
    """
    rows, models = identification.rows, identification.validation.models
    width = len(identification.prepared.model.base.columns) + 1
    factors = [
        joint.standardized_r_factor(model) for joint, model in zip(rows, models, strict=True)
    ]
    return _square(stacked_r_factor(factors, [joint.places for joint in rows], width))


def stacked(factors: Sequence[FloatArray]) -> FloatArray:
    """Return the R factor (b + 1, b + 1) of all rows behind several R factors."""
    return _square(r_factor(np.vstack(factors)))


def _square(factor: FloatArray) -> FloatArray:
    width = factor.shape[1]
    whole = np.zeros((width, width))
    signs = np.where(np.diag(factor) < 0.0, -1.0, 1.0)
    whole[: len(factor)] = factor[: len(signs)] * signs[:, None]
    return whole


def _why_not(result: IdentificationResult) -> str:
    """Return why a bag is represented by least squares; empty if the instruments are accepted."""
    accepted, tests = result.instruments.accepted, result.instruments.tests
    if accepted is None:
        reasons = (test.reason for test in tests if test.reason)
        reason = next(reasons, result.instruments.source)
        return f"the instruments could not be tested: {reason}"
    rejected = [test.scope for test in tests if test.accepted is False and test.scope != "all"]
    where = f" at {', '.join(rejected)}" if rejected else ""
    return "" if accepted else f"the instruments are rejected{where}"


def _join(segments: Sequence[Segment], left_out: Sequence[str]) -> dict[str, Any]:
    first, result = segments[0], segments[0].result
    factor = stacked([segment.r_factor for segment in segments])
    samples = {joint: sum(segment.rows[joint] for segment in segments) for joint in first.rows}
    weights = [sum(segment.rows.values()) for segment in segments]
    why = next(filter(None, (_why_not(segment.result) for segment in segments)), "")
    values, std = _values(segments, factor, sum(weights), instruments=not why)
    verdicts = [segment.result.verdict for segment in segments]
    worst = min(verdicts, key=lambda overall: _VERDICTS.index(overall.verdict))
    noise = np.array(
        [[[joint.rms for joint in s.result.residuals], s.floor] for s in segments], dtype=float
    )
    rms, floor = np.sqrt(np.average(noise**2, axis=0, weights=weights))
    checks = list(dict.fromkeys(check for segment in segments for check in segment.checks))
    count = len(segments) + len(left_out)
    if count > 1:
        checks.insert(0, f"read in {count} segments")
    given = [p.given_value for p in result.parameters if p.given_value is not None]
    time = None  # where the first stamp is no date
    with suppress(ValueError, OverflowError, OSError):
        start = datetime.fromtimestamp(first.start, timezone.utc)
        time = iso_time(start) if start.year >= _FIRST_YEAR else None
    return {
        "time": time,
        "duration": sum(segment.duration for segment in segments),
        "samples": samples,
        "names": tuple(p.name for p in result.parameters),
        "expressions": tuple(p.expression for p in result.parameters),
        "units": tuple(p.unit for p in result.parameters),
        "kinematics": result.kinematics,
        "effort_unit": result.effort_unit,
        "r_factor": factor,
        "rows": sum(weights),
        "noise": tuple(map(JointNoise, samples, rms.tolist(), floor.tolist())),
        "estimator": "idim-ls" if why else "idim-iv",
        "why_least_squares": why,
        "values": tuple(values.tolist()),
        "std": tuple(std.tolist()),
        "given": tuple(given) if len(given) == len(values) else None,
        "condition_number": max(segment.result.fit.condition_number for segment in segments),
        "verdict": worst.verdict,
        "sentence": worst.sentence,
        "checks": (*checks, *left_out),
    }


def _values(
    segments: Sequence[Segment], factor: FloatArray, rows: int, *, instruments: bool
) -> tuple[FloatArray, FloatArray]:
    """Return estimate and standard deviations (b,) of the bag from all its segments.

    Segments are independent: IDIM-IV estimates are averaged with the inverse of their covariances
    as weights, and least squares is solved on the stacked R factor.
    """
    kind = "" if instruments else "ls_"
    values, stds = (
        np.array([[getattr(p, kind + name) for p in s.result.parameters] for s in segments])
        for name in ("value", "std")
    )
    if len(segments) == 1:
        return values[0], stds[0]
    if instruments:
        weights = [np.linalg.inv(segment.result.covariance) for segment in segments]
        covariance = np.linalg.inv(np.sum(weights, axis=0))
        weighted = [weight @ value for weight, value in zip(weights, values, strict=True)]
        return covariance @ np.sum(weighted, axis=0), np.sqrt(np.diag(covariance))
    upper, right = factor[:-1, :-1], factor[:-1, -1]
    inverse = scipy.linalg.solve_triangular(upper, np.eye(len(upper)))
    variance = factor[-1, -1] ** 2 / max(1, rows - len(upper))
    return inverse @ right, np.sqrt(variance * np.sum(inverse**2, axis=1))
