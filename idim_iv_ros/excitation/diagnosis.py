"""A motion whose labelled segments separate the causes of a gap."""

from dataclasses import dataclass

import numpy as np

from idim_iv_ros.configuration import Configuration, ControllerSection
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.excitation.diagnosis_plan import DiagnosisPlanner
from idim_iv_ros.excitation.limit_use import (
    LimitUse,
    MovingFrames,
    limit_use,
    moving_frames,
    require_reachable,
)
from idim_iv_ros.excitation.limits import MotionLimits, require_inside
from idim_iv_ros.excitation.segments import Segment, SegmentPlan, Shape, effects_of, rest_to_rest
from idim_iv_ros.excitation.trajectory import Trajectory, require_sampling
from idim_iv_ros.model import InverseModel
from idim_iv_ros.progress import Progress
from idim_iv_ros.simulation import mass_matrix
from idim_iv_ros.types import FloatArray

SHORTEST, LONGEST = 90.0, 3600.0  # s
_TRIALS = 6
_REST = 0.5  # s before and after every segment
_SHORTEST_MOVE = 0.3  # s

UNKNOWN_BANDWIDTH = 6.0  # Hz, where the controller is not known


@dataclass(frozen=True)
class Diagnosis:
    """A motion for diagnosis.

    Attributes
    ----------
    trajectory : Trajectory
    segments : tuple of Segment
    use : LimitUse
        Over every sample.
    bandwidth : (n_joints,) Hz
        Of the position loops, as taken for the multisine.
    bandwidth_known : bool
    """

    trajectory: Trajectory
    segments: tuple[Segment, ...]
    use: LimitUse
    bandwidth: FloatArray
    bandwidth_known: bool

    @property
    def highest_frequency(self) -> float:
        """Of the multisine and the reversals, Hz."""
        return max(s.plan.frequency[1] for s in self.segments if s.plan.frequency is not None)


def design_diagnosis(
    model: InverseModel,
    limits: MotionLimits,
    configuration: Configuration,
    *,
    duration: float = 180.0,
    rate: float = 1000.0,
    seed: int = 1,
    start: FloatArray | None = None,
    progress: Progress | None = None,
) -> Diagnosis:
    """Compose a motion of labelled segments, at rest between them, within all limits.

    Parameters
    ----------
    duration
        Budget, s; at least 90.
    start
        (n_joints,) posture about which it moves; None: the middle of the ranges, or where that
        is below the floor the one of 2,000 postures that is highest above it.

    Raises
    ------
    UsageError
        Values outside their range, a floor that no posture keeps above.
    DataError
        The segments do not fit in the duration or keep the limits.
    """
    report = progress or (lambda stage, share: None)
    if not (np.isfinite(rate) and rate >= 100.0):
        raise UsageError(f"rate {rate:g}: a diagnosis needs 100 samples per second or more")
    if not SHORTEST <= duration <= LONGEST:
        raise UsageError(
            f"duration {duration:g}: {SHORTEST:g} to {LONGEST:g} s are needed for a diagnosis"
        )
    require_sampling(rate, duration, "the motion")
    frames = moving_frames(model.robot)
    posture = _posture(model, limits, frames, start)
    inertia = np.ones(len(posture))
    if limits.torque_known:
        mass = mass_matrix(model.robot, model.robot.given, posture[None])
        inertia = np.diagonal(mass[0])
    bandwidth, known = loop_bandwidth(configuration.controller, inertia)
    known = known and (limits.torque_known or configuration.controller.type == "cascade")
    planner = DiagnosisPlanner(model, limits, frames, posture, bandwidth, rate, seed)
    trajectory, segments = _fill(planner, duration, report)
    report("checking every sample", 1.0)
    use = limit_use(model.robot, limits, frames, trajectory)
    if not use.within(limits):
        raise DataError("no motion within the limits was found: a limit broke at full rate")
    return Diagnosis(trajectory, segments, use, bandwidth, known)


def loop_bandwidth(controller: ControllerSection, inertia: FloatArray) -> tuple[FloatArray, bool]:
    """Bandwidth of the position loops (n_joints,) Hz, and whether it is known.

    pd: √(kp / inertia) / 2π; cascade: kp / 2π; unknown controllers: 6 Hz.
    """
    if controller.kp is None:
        return np.full(len(inertia), UNKNOWN_BANDWIDTH), False
    gain = np.asarray(controller.kp, dtype=float)
    if controller.type == "cascade":
        return gain / (2.0 * np.pi), True
    return np.sqrt(gain / np.maximum(inertia, 1e-9)) / (2.0 * np.pi), True


def _fill(
    planner: DiagnosisPlanner, duration: float, report: Progress
) -> tuple[Trajectory, tuple[Segment, ...]]:
    """Size the segments so that they, with the moves between, take nearly `duration` s."""
    seconds, best = 0.7 * duration, None
    for trial in range(_TRIALS):
        report("composing segments", trial / _TRIALS)
        found = _Composer(planner).compose(planner.plans(seconds))
        total = found[0].duration
        if total <= duration and (best is None or total > best[0].duration):
            best = found
        if 0.97 * duration <= total <= duration:
            break
        seconds = max(1.0, seconds + (0.985 * duration - total) / 0.9)
    if best is None:
        raise DataError(
            f"the segments take {total:.0f} s at least: a longer --duration than {duration:g} s "
            "is needed"
        )
    return best


def _posture(
    model: InverseModel, limits: MotionLimits, frames: MovingFrames, start: FloatArray | None
) -> FloatArray:
    inner = limits.margin * limits.half_range
    if limits.floor is not None:
        require_reachable(frames, limits.floor, limits.middle - inner, limits.middle + inner)
    if start is not None:
        require_inside(start, limits, model.robot.joints)
        return start
    if limits.floor is None or np.min(frames.heights(limits.middle[None])) > limits.floor + 0.05:
        return limits.middle
    random = np.random.default_rng(7)
    postures = limits.middle + 0.5 * inner * random.uniform(-1.0, 1.0, (2000, len(inner)))
    return np.asarray(postures[np.argmax(frames.heights(postures).min(axis=1))])


class _Composer:
    """Joins segments by moves at rest and notes where each of them is."""

    def __init__(self, planner: DiagnosisPlanner) -> None:
        self.planner = planner
        self.parts: list[Shape] = []
        self.samples = 0
        self.place = np.zeros(len(planner.posture))

    def compose(self, plans: list[SegmentPlan]) -> tuple[Trajectory, tuple[Segment, ...]]:
        rate, joints = self.planner.rate, self.planner.model.robot.joints
        segments = []
        for plan in plans:
            self._move(plan.offset)
            self._hold()
            start = self.samples
            position, velocity, acceleration = plan.shape
            self._add((plan.offset + position, velocity, acceleration))
            end = self.samples
            effects = effects_of(plan.kind, len(joints))
            segments.append(Segment(plan, start / rate, end / rate, effects))
            self._hold()
        self._move(np.zeros(len(joints)))
        self._hold()
        position, velocity, acceleration = (
            np.vstack(part) for part in zip(*self.parts, strict=True)
        )
        posture = self.planner.posture
        trajectory = Trajectory(joints, rate, posture + position, velocity, acceleration)
        return trajectory, tuple(segments)

    def _add(self, part: Shape) -> None:
        self.parts.append(part)
        self.samples += len(part[0])

    def _hold(self) -> None:
        still = np.zeros((round(_REST * self.planner.rate), len(self.place)))
        self._add((still + self.place, still, still))

    def _move(self, target: FloatArray) -> None:
        way = target - self.place
        if np.all(np.abs(way) < 1e-12):
            return
        limits = self.planner.limits
        slow = 1.875 * np.abs(way) / (0.6 * limits.margin * limits.velocity)
        gentle = np.sqrt(5.774 * np.abs(way) / (0.3 * limits.margin * limits.acceleration))
        seconds = max(_SHORTEST_MOVE, float(np.max([slow, gentle])))
        for _ in range(8):
            shape = rest_to_rest(way, seconds, self.planner.rate)
            if self.planner.keeps(self.place, shape):
                self._add((self.place + shape[0], shape[1], shape[2]))
                self.place = target
                return
            seconds *= 1.4
        raise DataError("a move between two segments breaks a limit: give another --start")
