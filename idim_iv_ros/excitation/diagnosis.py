"""A motion whose labelled segments separate the causes of a gap."""

from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.configuration import Configuration, ControllerSection
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.excitation.diagnosis_plan import DiagnosisPlanner
from idim_iv_ros.excitation.limits import (
    LimitUse,
    MotionLimits,
    moving_frames,
    require_inside,
    require_reachable,
    use_within,
)
from idim_iv_ros.excitation.segments import Segment, rest_to_rest
from idim_iv_ros.excitation.trajectory import Trajectory, require_sampling, shortest_quintic
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
    """A motion for diagnosis."""

    trajectory: Trajectory
    segments: tuple[Segment, ...]
    use: LimitUse  # Over every sample
    bandwidth: FloatArray  # (n_joints,) Hz: of the position loops, as taken for the multisine
    bandwidth_known: bool

    @property
    def highest_frequency(self) -> float:
        """Of the multisine and the reversals, Hz."""
        return max(s.frequency[1] for s in self.segments if s.frequency is not None)


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

    - `duration`: budget, s; at least 90
    - `start`: (n_joints,) posture about which it moves; None: the middle of the ranges, or where
      that is below the floor the one of 2,000 postures that is highest above it

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
    posture = _posture(model, limits, start)
    inertia = np.ones(len(posture))
    if limits.torque_known:
        mass = mass_matrix(model.robot, model.robot.given, posture[None])
        inertia = np.diagonal(mass[0])
    bandwidth, configured = loop_bandwidth(configuration.controller, inertia)
    configured = configured and (limits.torque_known or configuration.controller.type == "cascade")
    planner = DiagnosisPlanner(model, limits.narrowed(), posture, bandwidth, rate, seed)
    trajectory, segments = _fill(planner, duration, report)
    report("checking every sample", 1.0)
    use = use_within(model.robot, limits, trajectory)
    return Diagnosis(trajectory, segments, use, bandwidth, configured)


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
        composed = _compose(planner, planner.plans(seconds))
        total = composed[0].duration
        if total <= duration and (best is None or total > best[0].duration):
            best = composed
        if 0.97 * duration <= total <= duration:
            break
        seconds = max(1.0, seconds + (0.985 * duration - total) / 0.9)
    if best is None:
        raise DataError(
            f"the segments take {total:.0f} s at least: a longer --duration than {duration:g} s "
            "is needed"
        )
    return best


def _posture(model: InverseModel, limits: MotionLimits, start: FloatArray | None) -> FloatArray:
    """Return the posture (n_joints,) about which the robot moves, see `design_diagnosis`."""
    frames = moving_frames(model.robot)
    require_reachable(frames, limits)
    if start is not None:
        require_inside(start, limits, model.robot.joints)
        return start
    if limits.floor is None or np.min(frames.heights(limits.middle[None])) > limits.floor + 0.05:
        return limits.middle
    random = np.random.default_rng(7)
    shares = random.uniform(-1.0, 1.0, (2000, len(limits.reach)))
    postures = limits.middle + 0.5 * limits.reach * shares
    return np.asarray(postures[np.argmax(frames.heights(postures).min(axis=1))])


def _compose(
    planner: DiagnosisPlanner, plans: list[Segment]
) -> tuple[Trajectory, tuple[Segment, ...]]:
    """Join segments by moves, at rest before and after each, and note where they are."""
    rate, joints = planner.rate, planner.model.robot.joints
    place = np.zeros(len(joints))
    rest = np.zeros((3, round(_REST * rate), len(joints)))
    parts: list[FloatArray] = []
    segments, samples = [], 0

    def go(target: FloatArray) -> int:
        """Move from where the last part ended, and rest; return the samples that it takes."""
        way = [] if np.all(np.abs(target - place) < 1e-12) else [_move(planner, place, target)]
        way.append(_moved(rest, target))
        parts.extend(way)
        return sum(part.shape[1] for part in way)

    for plan in plans:
        start = samples + go(plan.offset)
        parts.append(_moved(plan.shape, plan.offset))
        place = plan.offset
        end = start + plan.shape.shape[1]
        segments.append(replace(plan, start=start / rate, end=end / rate))
        samples = end + go(place)
    go(np.zeros(len(joints)))
    motion = _moved(np.concatenate(parts, axis=1), planner.posture)
    return Trajectory(joints, rate, *motion), tuple(segments)


def _moved(shape: FloatArray, offset: FloatArray) -> FloatArray:
    """Return a shape (3, n_samples, n_joints) with its positions moved by (n_joints,)."""
    return shape + np.stack([offset, 0.0 * offset, 0.0 * offset])[:, None]


def _move(planner: DiagnosisPlanner, start: FloatArray, target: FloatArray) -> FloatArray:
    """From rest to rest between two offsets from the posture, as slowly as the limits ask."""
    way, limits = target - start, planner.limits
    speed, acceleration = limits.margin * limits.velocity, limits.margin * limits.acceleration
    seconds = max(_SHORTEST_MOVE, shortest_quintic(way, 0.6 * speed, 0.3 * acceleration))
    for _ in range(8):
        shape = rest_to_rest(way, seconds, planner.rate)
        if planner.keeps(start, shape):
            return _moved(shape, start)
        seconds *= 1.4
    raise DataError("a move between two segments breaks a limit: give another --start")
