"""A motion whose labelled segments separate the causes of a gap: which, where, how fast.

The shape of a segment (3, n_samples, n_joints) starts and ends at rest: position, velocity and
acceleration relative to its start, at 0, 1/rate, … up to but without the end, where the next one
begins.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy

from idim_iv_ros.configuration import Configuration, ControllerSection
from idim_iv_ros.effects.registry import BY_NAME, CAUSES
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.excitation.limits import (
    LimitUse,
    MotionLimits,
    limit_use,
    moving_frames,
    require_inside,
    require_reachable,
    use_within,
)
from idim_iv_ros.excitation.trajectory import (
    QUINTIC_SPEED,
    Trajectory,
    quintic,
    require_sampling,
    shortest_quintic,
)
from idim_iv_ros.model import InverseModel
from idim_iv_ros.progress import Progress
from idim_iv_ros.simulation import joint_inertia
from idim_iv_ros.types import FloatArray

# Kinds of segment; which effects each reveals is in the files of `effects/`.
KINDS = ("repeat", "range_sweep", "creep", "plateau", "reversals", "multisine")
EFFECTS: dict[str, tuple[str, ...]] = {
    kind: tuple(cause.name for cause in CAUSES if kind in cause.segments) for kind in KINDS
}
NOT_REVEALED = {cause.name: cause.beyond_motion for cause in CAUSES if not cause.segments}

LOWEST_LINE = 0.5  # Hz
_FADE = 1.0  # s

# Pairs that no motion separates.
_NO_MOTION = {
    frozenset({"payload", "link_inertia"}): (
        "no motion does if the load is fixed to the link; take it off and record once more"
    ),
    frozenset({"torque_offset", "asymmetric_friction"}): (
        "no motion does: dry friction that differs between the directions is a constant torque "
        "beside its mean. Measure the torque without the drive's friction, behind the gear"
    ),
    frozenset({"position_ripple", "gain_ripple"}): (
        "no motion does in which the torque of the joint hardly changes: record the same positions "
        "once more under another load"
    ),
}


@dataclass(frozen=True)
class Segment:
    """A stretch of a motion for diagnosis, with the effects that it reveals."""

    name: str
    kind: str
    offset: FloatArray  # (n_joints,): where it starts, relative to the base posture, rad (m)
    shape: FloatArray  # (3, n_samples, n_joints): position, velocity, acceleration from its start
    speed: FloatArray | None = None  # (n_joints,): constant, of the way there, rad/s (m/s)
    amplitude: FloatArray | None = None  # (n_joints,): largest deviation, rad (m)
    frequency: tuple[float, float] | None = None  # (lowest, highest) Hz
    start: float = 0.0  # s, in the motion, once it has a place there
    end: float = 0.0  # s

    @property
    def effects(self) -> tuple[str, ...]:
        """Effects that the segment reveals on a robot with this number of joints."""
        joints = len(self.offset)
        return tuple(name for name in EFFECTS[self.kind] if joints >= BY_NAME[name].joints_needed)


def separating_motion(first: str, second: str) -> str:
    """Return in words which segments of ``excite --for diagnosis`` separate two effects.

    A segment that reveals one effect and not the other separates them; where there is none,
    those that reveal either are named. Empty where nothing is known of either.
    """
    pair = frozenset({first, second})
    if pair in _NO_MOTION:
        return _NO_MOTION[pair]
    apart = [kind for kind, effects in EFFECTS.items() if (first in effects) != (second in effects)]
    either = [kind for kind, effects in EFFECTS.items() if first in effects or second in effects]
    needs = [NOT_REVEALED[answer] for answer in (first, second) if answer in NOT_REVEALED]
    kinds = apart or either
    if kinds:
        names = " and ".join(filter(None, (", ".join(kinds[:-1]), kinds[-1])))
        plural = "s" if len(kinds) > 1 else ""
        needs.insert(0, f"the segment{plural} {names} of idim-iv excite --for diagnosis")
    return "; ".join(needs)


def rest_to_rest(displacement: FloatArray, seconds: float, rate: float) -> FloatArray:
    """Quintic shape from rest to rest, see `quintic`."""
    s, seconds = _phase(seconds, rate)
    return quintic(s) / seconds ** np.arange(3)[:, None, None] * displacement


def there_and_back(speed: FloatArray, plateau: float, ramp: float, rate: float) -> FloatArray:
    """Constant speed for `plateau` s, and the same way back.

    The speed rises and falls within `ramp` s as 3s² - 2s³, so that the acceleration is
    continuous, zero at both ends, and 1.5 speed / ramp at most. Its length is
    speed · (plateau + ramp).
    """
    rise, flat = len(_phase(ramp, rate)[0]), max(round(plateau * rate), 1)
    knots = np.cumsum([0, rise, flat, rise, rise, flat, rise])
    speeds = [0.0, 1.0, 1.0, 0.0, -1.0, -1.0, 0.0]
    level = scipy.interpolate.CubicHermiteSpline(knots / rate, speeds, np.zeros(7))
    time = np.arange(knots[-1])[:, None] / rate
    return np.stack([level.antiderivative()(time), level(time), level(time, 1)]) * speed


def waves(
    amplitude: FloatArray,
    frequency: FloatArray,
    phase: FloatArray,
    seconds: float,
    fade: float,
    rate: float,
) -> FloatArray:
    """Sum of sines of (n_lines, n_joints) each, faded in and out over `fade` s (quintic)."""
    s, seconds = _phase(seconds, rate)
    time = s * seconds
    position, velocity, acceleration = np.zeros((3, len(s), amplitude.shape[1]))
    for a, f, p in zip(amplitude, frequency, phase, strict=True):
        pulsation = 2.0 * np.pi * f
        position += a * np.sin(pulsation * time + p)
        velocity += a * pulsation * np.cos(pulsation * time + p)
        acceleration -= a * pulsation**2 * np.sin(pulsation * time + p)
    window, slope, curvature = quintic(np.clip(np.minimum(time, seconds - time) / fade, 0.0, 1.0))
    first, second = np.where(time <= seconds / 2.0, 1.0, -1.0) / fade * slope, curvature / fade**2
    faded_velocity = window * velocity + first * position
    faded_acceleration = window * acceleration + 2.0 * first * velocity + second * position
    return np.stack([window * position, faded_velocity, faded_acceleration])


def reversals(
    joints: int, amplitude: float, frequency: float, seconds: float, rate: float
) -> Segment:
    """The same sine, rad (m) and Hz, at all joints, faded in and out over one of its periods."""
    level, line = np.full((1, joints), amplitude), np.full((1, joints), frequency)
    shape = waves(level, line, np.zeros((1, joints)), seconds, 1.0 / frequency, rate)
    return Segment(
        f"reversals_{1000 * amplitude:g}_mrad_{frequency:g}_Hz",
        "reversals",
        np.zeros(joints),
        shape,
        amplitude=level[0],
        frequency=(frequency, frequency),
    )


def multisine(
    highest: FloatArray, amplitude: float, seconds: float, rate: float, seed: int
) -> Segment:
    """Sum of sines of random phase from 0.5 Hz up to `highest`, faded in and out over 1 s.

    No line k/T is shared: k ≡ joint modulo the number of joints, so that what one joint does to
    another is apart from its response. All lines have the same velocity. `highest`: (n_joints,) Hz;
    `amplitude`: largest deviation, rad (m).
    """
    joints = len(highest)
    flat = max(seconds - 2.0 * _FADE, 2.0 / LOWEST_LINE)
    # At least two lines for each joint, however slow its loop.
    highest = np.maximum(highest, LOWEST_LINE + 2.0 * joints / flat)
    numbers = np.arange(1, int(highest.max() * flat) + 1)[:, None]
    lines = numbers / flat
    of_joint = numbers % joints == np.arange(joints)
    used = of_joint & (lines >= LOWEST_LINE) & (lines <= highest)
    phase = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, used.shape)
    frequency = np.broadcast_to(lines, used.shape)
    level = np.where(used, 1.0 / frequency, 0.0)
    shape = waves(level, frequency, phase, flat + 2.0 * _FADE, _FADE, rate)
    return Segment(
        "multisine",
        "multisine",
        np.zeros(joints),
        amplitude / np.abs(shape[0]).max(axis=0) * shape,
        amplitude=np.full(joints, amplitude),
        frequency=(float(lines[used.any(axis=1)].min()), float(highest.max())),
    )


def _phase(seconds: float, rate: float) -> tuple[FloatArray, float]:
    """Progress from 0 up to but without 1, (n_samples, 1), and the seconds it really takes."""
    samples = max(int(np.ceil(seconds * rate - 1e-6)), 2)
    return np.arange(samples)[:, None] / samples, samples / rate


CREEP_SHARES = (0.005, 0.02)  # of the velocity limit
PLATEAU_SHARES = (1.0, 0.75, 0.5, 0.25, 0.1)  # of the fastest plateau that has room
REVERSALS = ((0.0005, 1.0), (0.0005, 4.0), (0.002, 1.0), (0.002, 4.0), (0.01, 1.0), (0.01, 4.0))
MULTISINE_AMPLITUDE = 0.005  # rad (m), largest deviation
BANDWIDTHS = 2.5  # of the position loop, at the upper end of the multisine
# Share of the time that the segments of a kind take together.
_SHARES = {
    "repeat": 0.12,
    "range_sweep": 0.34,
    "creep": 0.14,
    "plateau": 0.18,
    "reversals": 0.12,
    "multisine": 0.10,
}
_SHORTEST_RAMP = 0.15  # s
_SHORTEST_PLATEAU = 0.25  # s
_SAMPLES_PER_PERIOD = 40


@dataclass(frozen=True)
class DiagnosisPlanner:
    """Makes segments that keep all limits around a base posture."""

    model: InverseModel
    limits: MotionLimits
    posture: FloatArray  # (n_joints,) rad (m)
    bandwidth: FloatArray  # (n_joints,) Hz
    rate: float  # samples per second
    seed: int  # of the phases of the multisine

    def plans(self, seconds: float) -> list[Segment]:
        """All segments in order; together about `seconds` long, without the moves between."""
        time = {kind: share * seconds for kind, share in _SHARES.items()}
        repeat = self._repeat(time["repeat"] / 3.0)
        first = [*self._sweeps(time["range_sweep"] / 2.0), *self._creeps(time["creep"])]
        small = [
            reversals(len(self.posture), amplitude, frequency, slot, self.rate)
            for amplitude, frequency in REVERSALS
            for slot in [max(time["reversals"] / len(REVERSALS), 4.0 / frequency)]
        ]
        highest, long = np.minimum(BANDWIDTHS * self.bandwidth, self.rate / 10.0), time["multisine"]
        small.append(multisine(highest, MULTISINE_AMPLITUDE, long, self.rate, self.seed))
        second = [*self._plateaus(time["plateau"]), *map(self._sized, small)]
        named = [replace(repeat, name=f"repeat_{k}") for k in (1, 2, 3)]
        return [named[0], *first, named[1], *second, named[2]]

    def keeps(self, offset: FloatArray, shape: FloatArray, highest: float = 5.0) -> bool:
        """Whether a stretch keeps all limits, a little inside.

        Looked at with 40 samples for each period of its highest frequency (Hz): nothing between
        them rises above what is seen by more than 0.4 %.
        """
        step = max(1, int(self.rate / (_SAMPLES_PER_PERIOD * highest)))
        position, velocity, acceleration = shape[:, ::step]
        position = self.posture + offset + position
        motion = Trajectory(self.model.robot.joints, self.rate, position, velocity, acceleration)
        return limit_use(self.model.robot, self.limits, motion).within(self.limits)

    def _fit(self, make: Callable[[float], Segment]) -> Segment:
        """Largest size from 1 downwards at which a segment keeps all limits."""
        size = 1.0
        for _ in range(40):
            plan = make(size)
            if self.keeps(plan.offset, plan.shape, *(plan.frequency or ())[1:]):
                return plan
            size *= 0.9
        raise DataError(f"{make(size).name}: no size of this segment keeps the limits")

    def _ramp(self, speed: FloatArray) -> float:
        allowed = 0.5 * self.limits.margin * self.limits.acceleration
        return max(_SHORTEST_RAMP, float(np.max(1.5 * np.abs(speed) / allowed)))

    @property
    def _patterns(self) -> tuple[FloatArray, FloatArray]:
        """Directions (n_joints,) of joints together, and against each other."""
        together = np.ones(len(self.posture))
        return together, np.where(np.arange(len(together)) % 2 == 1, -1.0, 1.0)

    def _repeat(self, seconds: float) -> Segment:
        def make(size: float) -> Segment:
            # Half of the room, and no faster than half of the velocity limit.
            half = seconds / 2.0
            slow = 0.5 * self.limits.margin * self.limits.velocity * half / QUINTIC_SPEED
            way = size * np.minimum(0.5 * self.limits.room(self.posture), slow)
            there = rest_to_rest(way, half, self.rate)
            back = -there
            back[0] += way
            shape = np.concatenate([there, back], axis=1)
            return Segment("repeat", "repeat", np.zeros_like(way), shape, amplitude=way)

        return self._fit(make)

    def _sweeps(self, seconds: float) -> Iterator[Segment]:
        """The whole range, all joints in the same direction and in opposite ones."""
        ramp = self._ramp(self.limits.velocity)
        plateau = max(seconds / 2.0 - 2.0 * ramp, ramp)
        names = ("range_sweep_same_direction", "range_sweep_opposite_directions")
        for name, pattern in zip(names[: len(self.posture)], self._patterns, strict=False):

            def make(size: float, name: str = name, pattern: FloatArray = pattern) -> Segment:
                reach = pattern * self.limits.reach
                speed = 2.0 * size * reach / (plateau + ramp)
                low = size * (self.limits.middle - self.posture - reach)
                shape = there_and_back(speed, plateau, ramp, self.rate)
                return Segment(name, "range_sweep", low, shape, speed=speed)

            yield self._fit(make)

    def _creeps(self, seconds: float) -> Iterator[Segment]:
        slot, room = seconds / len(CREEP_SHARES) / 2.0, self.limits.room(self.posture)
        for number, share in enumerate(CREEP_SHARES, start=1):
            speed = share * self.limits.velocity
            yield self._plateau(f"creep_{number}", self.posture, room, speed, slot)

    def _plateaus(self, seconds: float) -> Iterator[Segment]:
        """Constant speeds at two postures, the fastest first: the way of slower ones is shorter."""
        slot = seconds / len(PLATEAU_SHARES) / 4.0
        shift = 0.4 * self.limits.room(self.posture) * self._patterns[1]
        fastest = self.limits.margin * self.limits.velocity
        shortest = _SHORTEST_PLATEAU + self._ramp(fastest)
        for place, pattern in enumerate(self._patterns, start=1):
            centre = self.posture + (place - 1) * shift
            room = self.limits.room(centre)
            # Where the range is too short for a plateau at full speed, slower.
            speed = pattern * np.minimum(fastest, 2.0 * room / shortest)
            for number, share in enumerate(PLATEAU_SHARES, start=1):
                name = f"plateau_{number}_posture_{place}"
                plan = self._plateau(name, centre, room, share * speed, slot)
                if plan.speed is not None and number == 1:
                    speed, room = plan.speed, 0.5 * np.abs(plan.shape[0]).max(axis=0)
                yield plan

    def _plateau(
        self, name: str, centre: FloatArray, room: FloatArray, fastest: FloatArray, slot: float
    ) -> Segment:
        """Constant speed forth and back through `centre` (n_joints,), within `slot` s.

        - `room`: (n_joints,), how far from the centre the joints may go, rad (m)
        - `fastest`: (n_joints,), speed to begin with, which is lowered until all limits hold
        """

        def make(size: float) -> Segment:
            speed = size * fastest
            ramp = self._ramp(speed)
            # The joint with the least room sets how long all of them keep their speed.
            longest = float(np.min(2.0 * room / np.abs(speed))) - ramp
            plateau = max(min(slot - 2.0 * ramp, longest), _SHORTEST_PLATEAU)
            offset = centre - self.posture - 0.5 * speed * (plateau + ramp)
            shape = there_and_back(speed, plateau, ramp, self.rate)
            return Segment(name, name.partition("_")[0], offset, shape, speed=speed)

        return self._fit(make)

    def _sized(self, plan: Segment) -> Segment:
        """The segment about the posture, made smaller where it would pass a limit."""

        def make(size: float) -> Segment:
            assert plan.amplitude is not None
            return replace(plan, shape=size * plan.shape, amplitude=size * plan.amplitude)

        return self._fit(make)


SHORTEST, LONGEST = 90.0, 3600.0  # s
_TRIALS = 6
_REST = 0.5  # s before and after every segment
_SHORTEST_MOVE = 0.3  # s

UNKNOWN_BANDWIDTH = 6.0  # Hz, where the controller is not known


@dataclass(frozen=True)
class Diagnosis:
    """A motion whose segments separate the causes of a gap, and what it uses of the limits."""

    trajectory: Trajectory
    segments: tuple[Segment, ...]
    use: LimitUse  # Over every sample
    bandwidth: FloatArray  # (n_joints,) Hz: of the position loops, as taken for the multisine
    bandwidth_configured: bool

    @property
    def highest_frequency(self) -> float:
        """Highest frequency of all segments (multisine and reversals), Hz."""
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

    Raises UsageError: values outside their range, a floor that no posture keeps above. DataError:
    the segments do not fit in the duration or keep the limits.
    """
    report = progress or (lambda stage, share: None)
    if not rate >= 100.0:
        raise UsageError(f"rate {rate:g}: a diagnosis needs 100 samples per second or more")
    if not SHORTEST <= duration <= LONGEST:
        raise UsageError(
            f"duration {duration:g}: {SHORTEST:g} to {LONGEST:g} s are needed for a diagnosis"
        )
    require_sampling(rate, duration, "the motion")
    frames, posture = moving_frames(model.robot), limits.middle
    require_reachable(frames, limits)
    if start is not None:
        require_inside(start, limits, model.robot.joints)
        posture = start
    elif limits.floor is not None and np.min(frames.heights(posture[None])) <= limits.floor + 0.05:
        shares = np.random.default_rng(7).uniform(-1.0, 1.0, (2000, len(limits.reach)))
        postures = limits.middle + 0.5 * limits.reach * shares
        posture = postures[np.argmax(frames.heights(postures).min(axis=1))]
    inertia = np.ones(len(posture))
    if limits.torque_checked:
        inertia = joint_inertia(model.robot, model.robot.given, posture[None])
    bandwidth, configured = loop_bandwidth(configuration.controller, inertia)
    configured &= limits.torque_checked or configuration.controller.type == "cascade"
    planner = DiagnosisPlanner(model, limits.narrowed(), posture, bandwidth, rate, seed)
    # The segments with the moves between are to take nearly the duration.
    seconds, best, total = 0.7 * duration, None, 0.0
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
    report("checking every sample", 1.0)
    trajectory, segments = best
    use = use_within(model.robot, limits, trajectory)
    return Diagnosis(trajectory, segments, use, bandwidth, configured)


def loop_bandwidth(controller: ControllerSection, inertia: FloatArray) -> tuple[FloatArray, bool]:
    """Bandwidth of the position loops (n_joints,) Hz, and whether a configured law gives it.

    pd: √(kp / inertia) / 2π; cascade: kp / 2π; unknown controllers: 6 Hz.
    """
    if controller.kp is None:
        return np.full(len(inertia), UNKNOWN_BANDWIDTH), False
    gain = np.asarray(controller.kp, dtype=float)
    if controller.type == "cascade":
        return gain / (2.0 * np.pi), True
    return np.sqrt(gain / np.maximum(inertia, 1e-9)) / (2.0 * np.pi), True


def _compose(
    planner: DiagnosisPlanner, plans: list[Segment]
) -> tuple[Trajectory, tuple[Segment, ...]]:
    """Join segments by moves, at rest before and after them, and note where they are."""
    rate, joints = planner.rate, planner.model.robot.joints
    place = home = np.zeros(len(joints))
    rest = np.zeros((3, round(_REST * rate), len(joints)))
    parts: list[FloatArray] = []
    segments: list[Segment] = []
    for plan in (*plans, None):
        target = home if plan is None else plan.offset
        if np.any(np.abs(target - place) >= 1e-12):
            parts.append(_move(planner, place, target))
        parts.append(_moved(rest, target))
        if plan is not None:
            start = sum(part.shape[1] for part in parts)
            end = start + plan.shape.shape[1]
            segments.append(replace(plan, start=start / rate, end=end / rate))
            parts += [_moved(plan.shape, target), _moved(rest, target)]
        place = target
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
