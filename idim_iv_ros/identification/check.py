"""Can a recording support an identification?  Recordings, joints and parameters, in words."""

from collections.abc import Iterable, Sequence
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
from idim_iv_ros.identification.prepare import PreparedRegression, prepare, read_configured
from idim_iv_ros.identification.sanity import JointFinding, Level, link_findings
from idim_iv_ros.model.parameters import unit_at
from idim_iv_ros.progress import Progress, Stopwatch
from idim_iv_ros.recording.recording import Recording
from idim_iv_ros.signal_source import topic_of
from idim_iv_ros.signals.motion import Motion
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
    """A sentence on a recording or a joint, and how much it limits the identification."""

    where: str
    level: Level
    sentence: str


@dataclass(frozen=True)
class ParameterVisibility:
    """What the excitation shows of one base parameter.

    - `smallest`: smallest value that differs from zero by two standard deviations; None if it
      cannot be seen at all. From the residual of least squares taken as white: a lower bound.
    - `relative_percent`: standard deviation in percent of the least-squares value
    - `seen`: ``well``, ``yes``, ``poorly`` or ``no``
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
        wrong = (finding for finding in prepared.joint_findings if finding.joint == joint)
        findings += _of_joints(prepared, wrong)
    topic = prepared.configuration.signals.link_states
    if topic is not None:
        behind = link_findings(prepared.motions, prepared.model.robot.joint_types)
        sentence = f"no joint has positions on {topic} in every recording: nothing is made of it"
        findings += _of_joints(prepared, behind) or [Finding(topic, "limited", sentence)]
    parameters, condition = _visibility(prepared, rows)
    unseen = [parameter.name for parameter in parameters if parameter.seen == "no"]
    if unseen:
        sentence = f"{', '.join(unseen)} cannot be separated from the other parameters"
        findings.append(Finding("excitation", "unusable", sentence))
    return CheckReport(findings=tuple(findings), parameters=parameters, condition_number=condition)


def _of_joints(prepared: PreparedRegression, findings: Iterable[JointFinding]) -> list[Finding]:
    joints = prepared.configuration.robot.joints
    return [Finding(joints[of.joint], of.level, of.sentence) for of in findings]


def _recording_findings(recording: Recording, motion: Motion) -> list[Finding]:
    invented = float(np.mean(~motion.signals.valid))
    good = [f"{recording.duration:.4g} s at {recording.rate:.5g} samples per second"]
    limited = []
    if recording.duration < _LEAST_DURATION:
        limited.append(f"only {recording.duration:.3g} s: standard deviations will be large")
    for clock in recording.clocks:
        if clock.source == "arrival":
            limited.append(f"{clock.topic}: no header stamps, arrival times are used")
        if clock.jitter * clock.rate > _JITTER_LIMIT:
            limited.append(f"{clock.topic}: stamps jitter by {1000 * clock.jitter:.3g} ms")
    if invented > 0.0:
        (limited if invented > _INVENTED_LIMIT else good).append(
            f"{100 * invented:.2g} % of the joint samples have no measurement; left out"
        )
    limited += [frozen.sentence for frozen in recording.frozen]
    for note in recording.notes:
        (limited if note.limits else good).append(note.sentence)
    return _findings(recording.path.name, good, limited)


def _findings(where: str, good: Sequence[str], limited: Sequence[str]) -> list[Finding]:
    return [
        *(Finding(where, "good", sentence) for sentence in good),
        *(Finding(where, "limited", sentence) for sentence in limited),
    ]


def _reference_findings(prepared: PreparedRegression) -> list[Finding]:
    signals = [motion.signals for motion in prepared.motions]
    missing = [of.name for of in signals if of.position_reference is None]
    if missing:
        sentence = (
            "no reference is read: the loop cannot be simulated, instruments will be smoothed "
            "measurements and cannot be tested"
        )
        return _findings(", ".join(missing), [], [sentence, *prepared.advice])
    findings = list(map(_reference_source, prepared.recordings))
    if prepared.configuration.controller.type == "unknown":
        sentence = "control law unknown: it will be fitted from reference, motion and torque"
        findings.append(Finding("controller", "limited", sentence))
    return findings


def _reference_source(recording: Recording) -> Finding:
    assert recording.position_reference is not None
    source, _, field = recording.position_reference.origin.rpartition(" ")
    sentence = f"the reference is {field} of {topic_of(source)}"
    level: Level = "good"
    rates = [clock.rate for clock in recording.clocks if clock.topic == source]
    if rates:
        sentence += f", at {rates[0]:.4g} Hz"
    if rates and rates[0] <= _SLOW_REFERENCE * recording.rate:
        level = "limited"
        sentence += (
            f", and interpolated to the {recording.rate:.4g} Hz of the joint states: let the "
            "controller publish its state at that rate"
        )
    return Finding(recording.path.name, level, sentence)


def _joint_findings(prepared: PreparedRegression, joint: int, name: str) -> list[Finding]:
    motions = prepared.motions
    torque = np.concatenate([motion.torque[:, joint] for motion in motions])
    position = np.concatenate([motion.position[motion.span, joint] for motion in motions])
    states = [
        motion.derivatives_of(motion.position[:, [joint]], 0, motion.span.stop - motion.span.start)
        for motion in motions
    ]
    speeds = [speed[:, 0] for _, speed, _ in states]
    acceleration = np.concatenate([acceleration[:, 0] for _, _, acceleration in states])
    fastest = float(np.abs(np.concatenate(speeds)).max())
    unit = unit_at("rad", prepared.model.robot.joint_types[joint])
    noise = _TIMES_NOISE * _noise(prepared, joint, order=1)
    threshold = max(float(prepared.minimum_speed[joint]), _MOVING * fastest, noise)
    reversals = sum(count_reversals(speed, threshold) for speed in speeds)
    limited = []
    if np.ptp(position) < _LEAST_RANGE:
        limited.append(f"moves over {np.ptp(position):.2g} {unit} only: gravity hardly changes")
    if reversals < _LEAST_REVERSALS:
        limited.append(f"{reversals} reversals: Coulomb friction and offset are hard to separate")
    size = np.abs(torque)
    # At the largest size exactly; the share of one lone peak is negligible.
    clipped = float(np.mean(size >= size.max() * (1.0 - 1e-9))) if size.max() > 0.0 else 0.0
    if clipped > _CLIPPED_SHARE:
        limited.append(
            f"{100 * clipped:.2g} % of the effort sits at its largest value "
            f"{size.max():.3g}: clipped, or a torque limit"
        )
    noise = _noise(prepared, joint, order=2)
    if np.std(acceleration) < _ACCELERATION_NOISE * noise:
        limited.append(
            f"acceleration is only {np.std(acceleration) / noise:.2g} times its noise: inertias "
            "will be biased by least squares; move faster or lower processing.position_cutoff"
        )
    moves = (
        f"moves over {np.ptp(position):.3g} {unit}, up to {fastest:.3g} {unit}/s "
        f"and {np.abs(acceleration).max():.3g} {unit}/s², {reversals} reversals"
    )
    return _findings(name, [moves], limited)


def count_reversals(speed: FloatArray, threshold: float) -> int:
    """Count changes of direction between stretches that are faster than a threshold.

    The noise of a joint at rest changes the sign of its speed all the time; a joint reverses where
    it moves the other way than it moved last.

    `speed`: (n_samples,) rad/s (m/s) of one recording; `threshold`: speed from which on the joint
    moves, rad/s (m/s).
    """
    moving = np.sign(speed[np.abs(speed) > threshold])
    return int(np.count_nonzero(np.diff(moving)))


def _noise(prepared: PreparedRegression, joint: int, *, order: int) -> float:
    """Standard deviation that the noise of the positions gives the speed (order 1, rad/s, m/s)
    or the acceleration (order 2) behind the position filter.

    The noise of the positions is taken as white, with the variance of what the filter removed.
    """
    densities = [
        np.var(motion.signals.position[motion.span, joint] - motion.position[motion.span, joint])
        / (motion.signals.rate / 2.0)
        for motion in prepared.motions
    ]
    slowest = min(motion.signals.rate for motion in prepared.motions)
    cutoffs = prepared.cutoffs
    cutoff = min(cutoffs.position, slowest / 2.0) if order == 1 else cutoffs.decimation
    power = 2 * order + 1
    energy = float(np.mean(densities)) * (2.0 * np.pi) ** (2 * order) * cutoff**power / power
    return float(np.sqrt(energy))


def _visibility(
    prepared: PreparedRegression, rows: Sequence[JointRows]
) -> tuple[tuple[ParameterVisibility, ...], float | None]:
    base = prepared.model.base
    count = len(base.columns)
    if any(len(joint) == 0 for joint in rows):
        return (), None
    words = list(zip(base.names, base.expressions, base.units, strict=True))
    unseen = unseen_parameters(rows, count)
    if unseen:
        return tuple(ParameterVisibility(*words[k], None, None, "no") for k in unseen), None
    estimate = solve_least_squares(rows, count)
    weighted = independent_basis(stacked(rows, count, 1.0 / estimate.sigma)[:, :count])
    std = np.linalg.norm(weighted.inverse_root(count), axis=1)
    relative = 100.0 * std / np.maximum(np.abs(estimate.values), 1e-300)
    seen = np.select([relative <= _WELL_SEEN, relative <= _SEEN], ["well", "yes"], "poorly")
    columns = (2.0 * std).tolist(), relative.tolist(), seen.tolist()
    shown = [ParameterVisibility(*of, *values) for of, *values in zip(words, *columns, strict=True)]
    return tuple(shown), condition_number(rows, count)
