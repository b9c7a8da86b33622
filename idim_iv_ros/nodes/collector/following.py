"""The robot follows a motion under supervision, and is stopped when anything is wrong."""

import threading
import time
from collections.abc import Callable

import numpy as np

from idim_iv_ros.errors import DataError, IdimError, UsageError
from idim_iv_ros.excitation.excite import Passes, stop
from idim_iv_ros.excitation.trajectory import Trajectory
from idim_iv_ros.nodes.collector.neighbours import LOOK, Controller
from idim_iv_ros.nodes.entry import Result, in_thread
from idim_iv_ros.nodes.joint_topic import JointPositions, Place
from idim_iv_ros.nodes.settings import CollectorSettings
from idim_iv_ros.types import FloatArray

STANDING = 0.2  # s in which a robot at rest moves less than STILL
STILL = 0.01  # rad (m)

_SIGN_OF_LIFE = 0.5  # s between two progress reports
_SETTLED = 3.0  # s until a robot that was stopped rests
_SLACK = 0.1  # s around the delay of the controller
_MOVED = 0.5  # share of the allowed error by which a robot that has begun moved
_STEP = 0.01  # s between two delays that are tried
_UNSEEN = 1.0  # s to wait for a motion that is too small to be noticed

Say = Callable[[str, float, float, str], None]
State = tuple[FloatArray, FloatArray]


class Course:
    """Waits during a collection, reports progress, and raises whatever must end the collection.

    `timeout` counts from construction, s. `allowed` returns whether the robot may be moved, `gone`
    whether no client waits for the goal any more. `say` takes the stage, the share done, the
    largest tracking error of the stage and its joint. `done` and `whole` are expected durations so
    far and in all, s; `trouble` returns another reason to end (empty: none).
    """

    def __init__(
        self, timeout: float, allowed: Callable[[], bool], gone: Callable[[], bool], say: Say
    ) -> None:
        self._timeout, self._deadline = timeout, time.monotonic() + timeout
        self._allowed, self._gone, self._say = allowed, gone, say
        self._cancelled = ""
        self._stage, self._worst, self._joint = "", 0.0, ""
        self._said = 0.0
        self.done, self.whole = 0.0, 1.0
        self.trouble: Callable[[], str] = str

    def cancel(self, why: str) -> None:
        """End the collection at the next `tick`; may be called from any thread."""
        self._cancelled = self._cancelled or why

    def reason_to_end(self) -> str:
        """Return why the collection must end; empty if it may go on."""
        if self._cancelled:
            return self._cancelled
        if not self._allowed():
            return "allow_motion was set to false"
        if time.monotonic() > self._deadline:
            return f"not finished within {self._timeout:g} s"
        if self._gone():
            return "who asked is gone"
        return self.trouble()

    def begin(self, stage: str) -> None:
        """Report the beginning of a stage."""
        self._stage, self._worst, self._joint = stage, 0.0, ""
        self._report_progress(at_once=True)

    def deviates(self, size: float, joint: str) -> None:
        """Remember the largest tracking error of the stage, rad (m), and its joint."""
        if size > self._worst:
            self._worst, self._joint = size, joint

    def proceed(self, done: float, stage: str = "") -> None:
        """Set the progress `done`, s of `whole`, and report it; at once if a `stage` begins."""
        self.done = done
        self._stage = stage or self._stage
        self._report_progress(at_once=bool(stage))

    def tick(self) -> None:
        """Sleep for `LOOK` seconds, then report progress; a DataError says why to end."""
        time.sleep(LOOK)
        reason = self.reason_to_end()
        if reason:
            raise DataError(reason)
        self._report_progress()

    def pause(self, seconds: float) -> None:
        """Let a time in seconds pass in ticks."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self.tick()

    def compute(
        self, compute: Callable[[Callable[[str, float], None]], Result], expected: float
    ) -> Result:
        """Compute in another thread while this one ticks, so that a reason to end is noticed.

        `compute` takes a callback for its progress, which raises when the computation shall end;
        `expected` is its share of `whole`.
        """
        begun = self.done
        given_up = threading.Event()

        def look(stage: str, share: float) -> None:
            if given_up.is_set():
                raise UsageError("given up")
            self.done = max(self.done, begun + share * expected)

        answer = in_thread(lambda: compute(look), "computation")
        try:
            while not answer.done():
                self.tick()
        except IdimError:
            given_up.set()
            raise
        self.done = begun + expected
        return answer.result()

    def _report_progress(self, at_once: bool = False) -> None:
        now = time.monotonic()
        if at_once or now > self._said + _SIGN_OF_LIFE:
            self._said = now
            self._say(self._stage, min(self.done / self.whole, 1.0), self._worst, self._joint)


class Supervision:
    """Compares where a robot is with where its trajectory should have it by now.

    The controller begins at an unknown time after the request. Until the robot moves, any delay up
    to `longest_delay`, s, is possible; then `delay` (None before) is the one that fits best, and
    must hold. `start` (n_joints,) is the position at the request; a deviation of `allowed`, rad
    (m), or more is a fault.
    """

    def __init__(
        self, motion: Trajectory, start: FloatArray, allowed: float, longest_delay: float
    ) -> None:
        self._motion, self._start = motion, start
        self._allowed, self._longest = allowed, longest_delay
        self.delay: float | None = None

    def look(self, elapsed: float, position: FloatArray) -> tuple[float, str]:
        """Return the largest distance from where the robot should be, rad (m), and its joint.

        `elapsed` is the time since the request, s; `position` is measured, (n_joints,) rad (m).
        """
        moved = float(np.abs(position - self._start).max()) > _MOVED * self._allowed
        if self.delay is None and moved:
            _, self.delay = self._nearest(elapsed, position, 0.0, self._longest)
        if self.delay is None:
            low, high = 0.0, self._longest
        else:
            low, high = max(self.delay - _SLACK, 0.0), self.delay + _SLACK
        place, _ = self._nearest(elapsed, position, low, high)
        size = float(np.abs(position - place).max())
        # Which joint it is shows at the delay itself: the one that fits best makes them equal.
        due, _ = self._nearest(elapsed, position, self.delay or 0.0, self.delay or 0.0)
        return size, self._motion.joints[int(np.argmax(np.abs(position - due)))]

    def ended(self, elapsed: float) -> bool:
        """Return whether the motion must be over `elapsed` seconds after the request."""
        delay = self._longest if self.delay is None else self.delay + _SLACK
        way = np.abs(self._motion.position - self._motion.position[0]).max()
        if way <= _MOVED * self._allowed:  # the robot may have gone all of it without being seen
            delay = min(delay, _UNSEEN)
        return elapsed > self._motion.duration + delay

    def planned(self, elapsed: float) -> State:
        """Return position and velocity (n_joints,) of the reference now, rad, rad/s.

        Before the robot has begun, these are the first position and zero.
        """
        if self.delay is None:
            return self._motion.position[0], np.zeros_like(self._motion.velocity[0])
        sample = round((elapsed - self.delay) * self._motion.rate)
        sample = min(max(sample, 0), len(self._motion.position) - 1)
        return self._motion.position[sample], self._motion.velocity[sample]

    def _nearest(
        self, elapsed: float, position: FloatArray, low: float, high: float
    ) -> tuple[FloatArray, float]:
        """Return the planned position nearest to `position` of delays low … high, s; its delay."""
        delays = low + _STEP * np.arange(round((high - low) / _STEP) + 1)
        samples = np.round((elapsed - delays) * self._motion.rate).astype(int)
        samples = np.clip(samples, 0, len(self._motion.position) - 1)
        places = self._motion.position[samples]
        best = int(np.argmin(np.abs(places - position).max(axis=1)))
        return places[best], float(delays[best])


class Follower:
    """Moves one robot along trajectories and supervises it."""

    def __init__(
        self,
        positions: JointPositions,
        controller: Controller,
        settings: Callable[[], CollectorSettings],
        course: Course,
    ) -> None:
        self._positions, self._controller = positions, controller
        self._settings, self._course = settings, course

    def position(self) -> FloatArray:
        """Return the measured position (n_joints,) rad (m); joint states must have arrived."""
        assert self._positions.last is not None
        return self._positions.last.position

    def follow(self, stage: str, motion: Trajectory, passes: Passes) -> None:
        """Move the robot along a motion; an IdimError says why it was stopped."""
        self._course.begin(stage)
        settings = self._settings()
        watch = Supervision(motion, self.position(), settings.tracking_error, settings.start_delay)
        done, begun = self._course.done, time.monotonic()
        self._controller.follow(motion, settings.point_rate * motion.rate / passes.full.rate)
        try:
            problem, moving = self._watch(watch, begun, motion.duration)
        except Exception:  # a defect must not leave a robot to itself
            self._halt(motion, passes, watch.planned(time.monotonic() - begun))
            raise
        if problem:
            self._halt(motion, passes, moving)
            raise DataError(f"stopped in {stage}: {problem}")
        self._course.done = done + motion.duration

    def _watch(self, watch: Supervision, begun: float, duration: float) -> tuple[str, State]:
        """Supervise the robot until its motion is over or a problem occurs.

        Returns the problem (empty: none), and the position and velocity (n_joints,) to stop from.
        """
        settings, positions = self._settings(), self._positions
        before, done = positions.last, self._course.done
        while not watch.ended(time.monotonic() - begun):
            time.sleep(LOOK)
            place, elapsed = positions.last, time.monotonic() - begun
            assert place is not None
            problem = self._course.reason_to_end() or self._controller.failure()
            if not problem and positions.age() > settings.stale_after:
                problem = f"no joint states on {positions.topic} for {positions.age():.2g} s"
            error, joint = watch.look(max(place.measured - begun, 0.0), place.position)
            self._course.deviates(error, joint)
            if problem:
                return problem, watch.planned(elapsed)
            if error > settings.tracking_error:
                problem = (
                    f"{joint} is {error:.3g} from where it should be, more than "
                    f"tracking_error {settings.tracking_error:g}"
                )
                if watch.delay is None:
                    problem += "; the robot does not move: does its controller run?"
                return problem, (place.position, _speed(before, place))
            if before is None or place.measured > before.measured + 2.0 * LOOK:
                before = place
            self._course.proceed(done + min(elapsed, duration))
        return "", (self.position(), np.zeros_like(self.position()))

    def _halt(self, motion: Trajectory, passes: Passes, moving: State) -> None:
        """Stop the robot from a position and velocity, and wait until it rests."""
        self._controller.halt(stop(motion.joints, *moving, passes.limits))
        until = time.monotonic() + _SETTLED
        still = None
        while time.monotonic() < until and self._positions.age() < STANDING:
            time.sleep(STANDING)
            here = self.position()
            if still is not None and np.abs(here - still).max() < STILL:
                return
            still = here


def _speed(before: Place | None, now: Place) -> FloatArray:
    """Return the mean velocity between two positions, rad/s (m/s); zero for equal times."""
    if before is None or now.measured <= before.measured:
        return np.zeros_like(now.position)
    return np.asarray((now.position - before.position) / (now.measured - before.measured))
