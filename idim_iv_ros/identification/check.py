"""Can a recording support an identification?  Recordings, joints and parameters, in words."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from idim_iv_ros.compilation import one_thread
from idim_iv_ros.configuration import Configuration
from idim_iv_ros.documents import Document
from idim_iv_ros.estimation.least_squares import (
    condition_number,
    solve_least_squares,
    stacked,
    unseen_parameters,
)
from idim_iv_ros.estimation.observation import streamed_rows
from idim_iv_ros.estimation.qr import independent_basis
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.files import CHECK_FORMAT, FilePaths
from idim_iv_ros.identification.link_encoders import link_encoders
from idim_iv_ros.identification.prepare import PreparedRegression, prepare, read_configured
from idim_iv_ros.identification.sanity import Level
from idim_iv_ros.model import BaseParameters
from idim_iv_ros.model.units import unit_at
from idim_iv_ros.progress import Progress, Stopwatch
from idim_iv_ros.recording import Recording
from idim_iv_ros.signal_source import topic_of
from idim_iv_ros.signals import Motion
from idim_iv_ros.types import FloatArray

_INVENTED_LIMIT = 0.05  # share of samples without a measurement
_JITTER_LIMIT = 0.2  # of the sampling interval
_CLIPPED_SHARE = 0.005  # of samples that sit exactly at the largest effort
_LEAST_RANGE = 0.1  # rad (m for a prismatic joint) that shows gravity and inertia
_LEAST_REVERSALS = 4
# A joint moves from this share of its largest speed on, and this many times its noise.
_MOVING, _TIMES_NOISE = 0.02, 5.0
_LEAST_DURATION = 5.0  # s
_ACCELERATION_NOISE = 3.0  # motion over noise
_SLOW_REFERENCE = 0.9  # of the rate of the joint states
_WELL_SEEN, _SEEN = 10.0, 30.0  # relative deviation in percent


@dataclass(frozen=True)
class Finding:
    """One sentence on a recording or a joint, and how much it limits the identification."""

    where: str
    level: Level
    sentence: str


@dataclass(frozen=True)
class ParameterVisibility:
    """What the excitation shows of one base parameter.

    Attributes
    ----------
    name, expression, unit : str
    smallest : float or None
        Smallest value that differs from zero by two standard deviations; None if it cannot be seen
        at all. From the residual of least squares taken as white: a lower bound.
    relative_percent : float or None
        Standard deviation in percent of the least-squares value.
    seen : str
        ``well``, ``yes``, ``poorly`` or ``no``.
    """

    name: str
    expression: str
    unit: str
    smallest: float | None
    relative_percent: float | None
    seen: str


@dataclass(frozen=True, kw_only=True)
class CheckReport(Document):
    """All findings; `usable` is false when an identification would be refused."""

    what: ClassVar[str] = "a check"
    written_by: ClassVar[str] = "check"

    format: Literal["idim_iv_ros/check/1"] = CHECK_FORMAT
    usable: bool = True
    findings: tuple[Finding, ...]
    parameters: tuple[ParameterVisibility, ...]
    condition_number: float | None

    def __post_init__(self) -> None:
        usable = all(finding.level != "unusable" for finding in self.findings)
        object.__setattr__(self, "usable", usable)


def check(
    bags: FilePaths, configuration: Configuration, progress: Progress | None = None
) -> CheckReport:
    """Look at recordings, joints and parameters without identifying anything.

    Raises
    ------
    UsageError, DataError
        The recordings cannot be read or filtered at all; see `prepare`.
    """
    with one_thread(), Stopwatch(progress) as watch:
        watch.stage("reading", 0.0)
        recordings = read_configured(bags, configuration, progress)
        watch.stage("model and filters", 0.3)
        prepared = prepare(recordings, configuration)
        watch.stage("regressor", 0.6)
        rows = streamed_rows(prepared.model, prepared.motions)
        watch.stage("excitation", 0.7)
        return _report(prepared, rows)


def _report(prepared: PreparedRegression, rows: Sequence[JointRows]) -> CheckReport:
    findings = [Finding("nominal model", "limited", doubt) for doubt in prepared.doubts]
    for recording, motion in zip(prepared.recordings, prepared.motions, strict=True):
        findings += _recording_findings(recording, motion)
    findings += _reference_findings(prepared)
    for joint, name in enumerate(prepared.configuration.robot.joints):
        findings += _joint_findings(prepared, joint, name)
        if len(rows[joint]) == 0:
            findings.append(Finding(name, "unusable", "never faster than the reversal speed"))
        findings += [
            Finding(name, joint_finding.level, joint_finding.sentence)
            for joint_finding in prepared.joint_findings
            if joint_finding.joint == joint
        ]
    findings += _link_findings(prepared)
    parameters, condition = _visibility(prepared, rows)
    unseen = [parameter.name for parameter in parameters if parameter.seen == "no"]
    if unseen:
        sentence = f"{', '.join(unseen)} cannot be separated from the other parameters"
        findings.append(Finding("excitation", "unusable", sentence))
    return CheckReport(findings=tuple(findings), parameters=parameters, condition_number=condition)


def _recording_findings(recording: Recording, motion: Motion) -> list[Finding]:
    name = recording.path.name
    findings = [
        Finding(
            name, "good", f"{recording.duration:.4g} s at {recording.rate:.5g} samples per second"
        )
    ]
    if recording.duration < _LEAST_DURATION:
        sentence = f"only {recording.duration:.3g} s: standard deviations will be large"
        findings.append(Finding(name, "limited", sentence))
    for clock in recording.clocks:
        if clock.source == "arrival":
            sentence = f"{clock.topic}: no header stamps, arrival times are used"
            findings.append(Finding(name, "limited", sentence))
        if clock.jitter * clock.rate > _JITTER_LIMIT:
            sentence = f"{clock.topic}: stamps jitter by {1000 * clock.jitter:.3g} ms"
            findings.append(Finding(name, "limited", sentence))
    invented = float(np.mean(~motion.signals.valid))
    if invented > 0.0:
        level: Level = "limited" if invented > _INVENTED_LIMIT else "good"
        sentence = f"{100 * invented:.2g} % of the joint samples have no measurement; left out"
        findings.append(Finding(name, level, sentence))
    findings += [Finding(name, "limited", frozen.sentence) for frozen in recording.frozen]
    findings += [
        Finding(name, "limited" if note.limits else "good", note.sentence)
        for note in recording.notes
    ]
    return findings


def _reference_findings(prepared: PreparedRegression) -> list[Finding]:
    missing = [
        motion.signals.name
        for motion in prepared.motions
        if motion.signals.position_reference is None
    ]
    if missing:
        sentence = (
            "no reference is read: the loop cannot be simulated, instruments will be smoothed "
            "measurements and cannot be tested"
        )
        where = ", ".join(missing)
        sentences = (sentence, *prepared.advice)
        return [Finding(where, "limited", sentence) for sentence in sentences]
    findings = [
        _reference_source(recording, motion.signals.name)
        for recording, motion in zip(prepared.recordings, prepared.motions, strict=True)
    ]
    if prepared.configuration.controller.type == "unknown":
        sentence = "control law unknown: it will be fitted from reference, motion and torque"
        findings.append(Finding("controller", "limited", sentence))
    return findings


def _reference_source(recording: Recording, name: str) -> Finding:
    """Say where the reference comes from, and at which rate."""
    assert recording.position_reference is not None
    source, _, field = recording.position_reference.origin.rpartition(" ")
    sentence = f"the reference is {field} of {topic_of(source)}"
    rates = [clock.rate for clock in recording.clocks if clock.topic == source]
    if rates:
        sentence += f", at {rates[0]:.4g} Hz"
    if not rates or rates[0] > _SLOW_REFERENCE * recording.rate:
        return Finding(name, "good", sentence)
    return Finding(
        name,
        "limited",
        f"{sentence}, and interpolated to the {recording.rate:.4g} Hz of the joint states: let the "
        "controller publish its state at that rate",
    )


def _joint_findings(prepared: PreparedRegression, joint: int, name: str) -> list[Finding]:
    torque = np.concatenate([motion.torque[:, joint] for motion in prepared.motions])
    position = np.concatenate([motion.position[motion.span, joint] for motion in prepared.motions])
    speeds, accelerations = [], []
    for motion in prepared.motions:
        samples = motion.span.stop - motion.span.start
        derivatives = motion.derivatives_of(motion.position[:, [joint]], 0, samples)
        speeds.append(derivatives[1][:, 0])
        accelerations.append(derivatives[2][:, 0])
    speed, acceleration = np.concatenate(speeds), np.concatenate(accelerations)
    unit = unit_at("rad", prepared.model.robot.joint_types[joint])
    threshold = max(
        float(prepared.minimum_speed[joint]),
        _MOVING * float(np.abs(speed).max()),
        _TIMES_NOISE * _speed_noise(prepared, joint),
    )
    reversals = sum(count_reversals(speed, threshold) for speed in speeds)
    findings = [
        Finding(
            name,
            "good",
            f"moves over {np.ptp(position):.3g} {unit}, up to {np.abs(speed).max():.3g} {unit}/s "
            f"and {np.abs(acceleration).max():.3g} {unit}/s², {reversals} reversals",
        )
    ]
    if np.ptp(position) < _LEAST_RANGE:
        sentence = f"moves over {np.ptp(position):.2g} {unit} only: gravity hardly changes"
        findings.append(Finding(name, "limited", sentence))
    if reversals < _LEAST_REVERSALS:
        sentence = f"{reversals} reversals: Coulomb friction and offset are hard to separate"
        findings.append(Finding(name, "limited", sentence))
    clipped = _clipped_share(torque)
    if clipped > _CLIPPED_SHARE:
        sentence = (
            f"{100 * clipped:.2g} % of the effort sits at its largest value "
            f"{np.abs(torque).max():.3g}: clipped, or a torque limit"
        )
        findings.append(Finding(name, "limited", sentence))
    ratio = _acceleration_over_noise(prepared, joint, float(np.std(acceleration)))
    if ratio < _ACCELERATION_NOISE:
        sentence = (
            f"acceleration is only {ratio:.2g} times its noise: inertias will be biased by least "
            "squares; move faster or lower processing.position_cutoff"
        )
        findings.append(Finding(name, "limited", sentence))
    return findings


def _link_findings(prepared: PreparedRegression) -> list[Finding]:
    """Say what encoders behind the gears hold, where the configuration names their topic."""
    topic = prepared.configuration.signals.link_states
    if topic is None:
        return []
    joints, types = prepared.configuration.robot.joints, prepared.model.robot.joint_types
    found = link_encoders(prepared.motions, joints, types)
    if not found:
        sentence = f"no joint has positions on {topic} in every recording: nothing is made of it"
        return [Finding(topic, "limited", sentence)]
    return [
        Finding(each.joint, "limited", each.problem)
        if each.problem
        else Finding(each.joint, "good", each.sentence)
        for each in found
    ]


def count_reversals(speed: FloatArray, threshold: float) -> int:
    """Count changes of direction between stretches that are faster than a threshold.

    The noise of a joint at rest changes the sign of its speed all the time; a joint reverses where
    it moves the other way than it moved last.

    Parameters
    ----------
    speed
        (n_samples,) rad/s (m/s) of one recording.
    threshold
        Speed from which on the joint moves, rad/s (m/s).
    """
    moving = np.sign(speed[np.abs(speed) > threshold])
    return int(np.count_nonzero(np.diff(moving)))


def _clipped_share(torque: FloatArray) -> float:
    """Share of samples exactly at the largest magnitude; that of one lone peak is negligible."""
    size = np.abs(torque)
    return float(np.mean(size >= size.max() * (1.0 - 1e-9))) if size.max() > 0.0 else 0.0


def _acceleration_over_noise(
    prepared: PreparedRegression, joint: int, acceleration: float
) -> float:
    """Motion over the noise that the position filter lets into the acceleration.

    The noise of the positions is taken as white, with the variance of what the filter removed.
    """
    density, cutoff = _noise_density(prepared, joint), prepared.cutoffs.decimation
    noise = np.sqrt(density * (2.0 * np.pi) ** 4 * cutoff**5 / 5.0)
    return acceleration / noise if noise > 0.0 else np.inf


def _speed_noise(prepared: PreparedRegression, joint: int) -> float:
    """Standard deviation that the noise of the positions gives the filtered speed, rad/s (m/s)."""
    slowest = min(motion.signals.rate for motion in prepared.motions)
    cutoff = min(prepared.cutoffs.position, slowest / 2.0)
    density = _noise_density(prepared, joint)
    return float(np.sqrt(density * (2.0 * np.pi) ** 2 * cutoff**3 / 3.0))


def _noise_density(prepared: PreparedRegression, joint: int) -> float:
    """Power density of the positions' noise, rad²/Hz (m²/Hz): of what the filters removed."""
    densities = []
    for motion in prepared.motions:
        removed = motion.signals.position[motion.span, joint] - motion.position[motion.span, joint]
        densities.append(float(np.var(removed)) / (motion.signals.rate / 2.0))
    return float(np.mean(densities))


def _visibility(
    prepared: PreparedRegression, rows: Sequence[JointRows]
) -> tuple[tuple[ParameterVisibility, ...], float | None]:
    base = prepared.model.base
    count = len(base.columns)
    if any(len(joint) == 0 for joint in rows):
        return (), None
    unseen = unseen_parameters(rows, count)
    if unseen:
        return tuple(_parameter(base, k, None, 0.0) for k in unseen), None
    found = solve_least_squares(rows, count)
    weighted = independent_basis(stacked(rows, count, 1.0 / found.sigma)[:, :count])
    std = np.linalg.norm(weighted.inverse_root(count), axis=1)
    parameters = tuple(
        _parameter(base, k, float(std[k]), abs(float(found.values[k]))) for k in range(count)
    )
    return parameters, condition_number(rows, count)


def _parameter(
    base: BaseParameters, place: int, std: float | None, size: float
) -> ParameterVisibility:
    relative, smallest, seen = None, None, "no"
    if std is not None:
        relative = 100.0 * std / max(size, 1e-300)
        smallest = 2.0 * std
        seen = "well" if relative <= _WELL_SEEN else "yes" if relative <= _SEEN else "poorly"
    return ParameterVisibility(
        base.names[place], base.expressions[place], base.units[place], smallest, relative, seen
    )
