"""One bag identified: its own estimate, and the R factor that represents it among others."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import Any

import numpy as np
import scipy

from idim_iv_ros.compilation import one_thread
from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import DataError
from idim_iv_ros.estimation.qr import r_factor, stacked_r_factor
from idim_iv_ros.fleet.bag_result import JointNoise
from idim_iv_ros.fleet.source import iso_time
from idim_iv_ros.identification.assembly import assemble_result
from idim_iv_ros.identification.identify import Identified, identified
from idim_iv_ros.identification.prepare import loss_sentences
from idim_iv_ros.identification.result import Estimator, IdentificationResult
from idim_iv_ros.progress import Stopwatch
from idim_iv_ros.recording import Recording
from idim_iv_ros.signals import torque_noise
from idim_iv_ros.statistics.verdict import Verdict
from idim_iv_ros.types import FloatArray

# Verdicts on an estimate, the worst first: a bag in segments has that of its worst.
_VERDICTS: tuple[Verdict, ...] = ("misspecified", "inconclusive", "autocorrelated", "valid")
# Stamps before this year are no dates: seconds since a controller was switched on.
_FIRST_YEAR = 2000


@dataclass(frozen=True)
class SegmentEstimate:
    """What is kept of one segment; see `BagResult` for the fields that it has, too.

    Attributes
    ----------
    start, duration : float
        s, on the clock of the bag.
    noise : (2, n_joints)
        rms of the residual, and noise floor.
    covariance : (p, p)
        Of the IDIM-IV estimate.
    values, std, ls_values, ls_std : (p,)
        Of IDIM-IV and of joint-weighted IDIM-LS.
    accepted : bool or None
        Of the instruments.
    """

    start: float
    duration: float
    samples: dict[str, int]
    names: tuple[str, ...]
    expressions: tuple[str, ...]
    units: tuple[str, ...]
    kinematics: str
    effort_unit: str
    r_factor: FloatArray
    rows: int
    noise: FloatArray
    values: FloatArray
    std: FloatArray
    covariance: FloatArray
    ls_values: FloatArray
    ls_std: FloatArray
    given: tuple[float, ...] | None
    condition_number: float
    accepted: bool | None
    why_not_accepted: str
    verdict: Verdict
    sentence: str
    checks: tuple[str, ...]


def bag_fields(
    recordings: Iterable[Recording | DataError], configuration: Configuration
) -> dict[str, Any]:
    """Identify the segments of one bag, one after the other, and join them.

    Returns
    -------
    dict
        Fields of `BagResult`, from `time` and `duration` on.

    Raises
    ------
    UsageError, DataError
        As `identify`; a segment that supports no estimate is left out if another one does.
    """
    segments: list[SegmentEstimate] = []
    left_out: list[str] = []
    first: DataError | None = None
    with one_thread():
        for recording in recordings:
            try:
                if isinstance(recording, DataError):
                    raise recording
                segments.append(_segment(recording, configuration))
            except DataError as error:
                first = first or error
                left_out.append(f"a segment is left out: {error}")
    if not segments:
        raise first or DataError("the bag holds no recording")
    return _joined(segments, left_out)


def _segment(recording: Recording, configuration: Configuration) -> SegmentEstimate:
    found = identified([recording], configuration, "idim-iv", Stopwatch(None))
    result = assemble_result(found.prepared, found.estimates, found.validation)
    parameters = result.parameters
    given = [each.given_value for each in parameters]
    floor = torque_noise(found.prepared.motions)
    rows = found.estimates.rows
    return SegmentEstimate(
        start=recording.start,
        duration=recording.duration,
        samples={joint.name: len(joint) for joint in rows},
        names=tuple(each.name for each in parameters),
        expressions=tuple(each.expression for each in parameters),
        units=tuple(each.unit for each in parameters),
        kinematics=result.kinematics,
        effort_unit=result.effort_unit,
        r_factor=whitened_r_factor(found),
        rows=sum(len(joint) for joint in rows),
        noise=np.array([[each.rms for each in result.residuals], floor]),
        values=np.array([each.value for each in parameters]),
        std=np.array([each.std for each in parameters]),
        covariance=result.covariance,
        ls_values=np.array([each.ls_value for each in parameters]),
        ls_std=np.array([each.ls_std for each in parameters]),
        given=tuple(g for g in given if g is not None) if None not in given else None,
        condition_number=result.fit.condition_number,
        accepted=result.instruments.accepted,
        why_not_accepted=_why_not(result),
        verdict=result.verdict.verdict,
        sentence=result.verdict.sentence,
        checks=loss_sentences([recording]),
    )


def whitened_r_factor(found: Identified) -> FloatArray:
    """R (b + 1, b + 1) of [X y] of all joints, each whitened by the model of its own residual.

    The whitened residual has unit variance: rows of different joints and bags count as they should
    when they are stacked. The diagonal is not negative, so that equal rows have equal factors.
    """
    rows, models = found.estimates.rows, found.estimates.refined.models
    width = len(found.prepared.model.base.columns) + 1
    plain = [joint.with_instruments(joint.matrix) for joint in rows]
    factors = [
        joint.standardized_r_factor(model) for joint, model in zip(plain, models, strict=True)
    ]
    factor = stacked_r_factor(factors, [joint.places for joint in plain], width)
    return square(factor)


def square(factor: FloatArray) -> FloatArray:
    """R factor with as many rows as columns and no negative diagonal."""
    width = factor.shape[1]
    whole = np.zeros((width, width))
    signs = np.where(np.diag(factor) < 0.0, -1.0, 1.0)
    whole[: len(factor)] = factor[: len(signs)] * signs[:, None]
    return whole


def _why_not(result: IdentificationResult) -> str:
    """Why IDIM-IV is not what the fleet takes of this bag."""
    instruments = result.instruments
    if instruments.accepted:
        return ""
    if instruments.accepted is None:
        reason = next((test.reason for test in instruments.tests if test.reason), None)
        return f"the instruments could not be tested: {reason or instruments.source}"
    rejected = [t.scope for t in instruments.tests if t.accepted is False and t.scope != "all"]
    where = f" at {', '.join(rejected)}" if rejected else ""
    return f"the instruments are rejected{where}"


def _joined(segments: Sequence[SegmentEstimate], left_out: Sequence[str]) -> dict[str, Any]:
    first = segments[0]
    factor = square(r_factor(np.vstack([each.r_factor for each in segments])))
    rows = sum(each.rows for each in segments)
    why = next((each.why_not_accepted for each in segments if not each.accepted), "")
    estimator: Estimator = "idim-ls" if why else "idim-iv"
    values, std = _values(segments, factor, rows, estimator)
    worst = min(segments, key=lambda each: _VERDICTS.index(each.verdict))
    weights = [each.rows / rows for each in segments]
    squares = sum(w * each.noise**2 for w, each in zip(weights, segments, strict=True))
    noise = np.sqrt(squares)
    checks = list(dict.fromkeys(check for each in segments for check in each.checks))
    if len(segments) + len(left_out) > 1:
        checks.insert(0, f"read in {len(segments) + len(left_out)} segments")
    return {
        "time": date_of(first.start),
        "duration": sum(each.duration for each in segments),
        "samples": {
            joint: sum(each.samples[joint] for each in segments) for joint in first.samples
        },
        "names": first.names,
        "expressions": first.expressions,
        "units": first.units,
        "kinematics": first.kinematics,
        "effort_unit": first.effort_unit,
        "r_factor": factor,
        "rows": rows,
        "noise": tuple(
            JointNoise(joint, float(rms), float(floor))
            for joint, rms, floor in zip(first.samples, *noise, strict=True)
        ),
        "estimator": estimator,
        "why_least_squares": why,
        "values": tuple(map(float, values)),
        "std": tuple(map(float, std)),
        "given": first.given,
        "condition_number": max(each.condition_number for each in segments),
        "verdict": worst.verdict,
        "sentence": worst.sentence,
        "checks": (*checks, *left_out),
    }


def _values(
    segments: Sequence[SegmentEstimate], factor: FloatArray, rows: int, estimator: Estimator
) -> tuple[FloatArray, FloatArray]:
    """Estimate of the bag: its own, or that of all segments together.

    Segments are independent: IDIM-IV estimates are averaged with the inverse of their covariances
    as weights, and least squares is solved on the stacked R factor.
    """
    if len(segments) == 1:
        (one,) = segments
        iv = estimator == "idim-iv"
        return (one.values, one.std) if iv else (one.ls_values, one.ls_std)
    if estimator == "idim-iv":
        weights = [np.linalg.inv(each.covariance) for each in segments]
        covariance = np.linalg.inv(np.sum(weights, axis=0))
        pairs = zip(weights, segments, strict=True)
        values = covariance @ np.sum([w @ each.values for w, each in pairs], axis=0)
        return values, np.sqrt(np.diag(covariance))
    upper, right = factor[:-1, :-1], factor[:-1, -1]
    inverse = scipy.linalg.solve_triangular(upper, np.eye(len(upper)))
    variance = factor[-1, -1] ** 2 / max(1, rows - len(upper))
    return inverse @ right, np.sqrt(variance * np.sum(inverse**2, axis=1))


def date_of(stamp: float) -> str | None:
    """ISO 8601 of the first stamp of a recording; None where the stamps are no dates."""
    try:
        time = datetime.fromtimestamp(stamp, timezone.utc)
    except (ValueError, OverflowError, OSError):
        return None
    return iso_time(time) if time.year >= _FIRST_YEAR else None
