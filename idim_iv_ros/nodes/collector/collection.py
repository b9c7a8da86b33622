"""One goal of the collector: plan, move, record, check, identify; stop the robot on any fault."""

import contextlib
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
from rclpy.node import Node

from idim_iv_interfaces.action import Collect
from idim_iv_ros.errors import DataError, IdimError, UsageError, one_line
from idim_iv_ros.excitation.excite import Kind, Passes, passes_of, plan_passes, stop
from idim_iv_ros.excitation.trajectory import Trajectory
from idim_iv_ros.identification.check import check
from idim_iv_ros.nodes.collector.neighbours import (
    LOOK,
    Controller,
    IdentifierNeighbour,
    RecorderNeighbour,
)
from idim_iv_ros.nodes.entry import Result, in_thread
from idim_iv_ros.nodes.joint_topic import JointPositions
from idim_iv_ros.nodes.parameters import read_configuration
from idim_iv_ros.nodes.settings import CollectorSettings
from idim_iv_ros.types import FloatArray

_STANDING = 0.2  # s in which a robot at rest moves less than _STILL
_STILL = 0.01  # rad (m)
_REST = 0.5  # s that are recorded before and after the motion
_DISCOVERY = 3.0  # s until a node must be discovered
_CHECK, _IDENTIFICATION = 5.0, 20.0  # s, about, for the progress
_PLANNING = 0.1  # share of the progress: the duration is known only afterwards
_SIGN_OF_LIFE = 0.5  # s between two progress reports
_SETTLED = 3.0  # s until a robot that was stopped rests
_SLACK = 0.1  # s around the delay of the controller
_MOVED = 0.5  # share of the allowed error by which a robot that has begun moved
_STEP = 0.01  # s between two delays that are tried
_UNSEEN = 1.0  # s to wait for a motion that is too small to be noticed

State = tuple[FloatArray, FloatArray]


@dataclass
class Supervision:
    """Compares where a robot is with where its trajectory should have it by now.

    The controller begins at an unknown time after the request. Until the robot moves, any delay up
    to the longest is possible; then `delay` is the one that fits best, and must hold.
    """

    motion: Trajectory
    start: FloatArray  # (n_joints,), position at the request, rad (m)
    allowed: float  # deviation, rad (m)
    longest_delay: float  # s
    delay: float | None = None

    def look(self, elapsed: float, position: FloatArray) -> tuple[float, str]:
        """Return the largest distance from where the robot should be, rad (m), and its joint.

        The time `elapsed` is since the request, s; `position` (n_joints,) is measured, rad (m).
        """
        moved = float(np.abs(position - self.start).max()) > _MOVED * self.allowed
        if self.delay is None and moved:
            _, self.delay = self._nearest(elapsed, position, 0.0, self.longest_delay)
        low, high = 0.0, self.longest_delay
        if self.delay is not None:
            low, high = max(self.delay - _SLACK, 0.0), self.delay + _SLACK
        place, _ = self._nearest(elapsed, position, low, high)
        size = float(np.abs(position - place).max())
        # Which joint it is shows at the delay itself: the one that fits best makes them equal.
        due, _ = self._nearest(elapsed, position, self.delay or 0.0, self.delay or 0.0)
        return size, self.motion.joints[int(np.argmax(np.abs(position - due)))]

    def ended(self, elapsed: float) -> bool:
        """Return whether the motion must be over `elapsed` seconds after the request."""
        delay = self.longest_delay if self.delay is None else self.delay + _SLACK
        way = np.abs(self.motion.position - self.motion.position[0]).max()
        if way <= _MOVED * self.allowed:  # the robot may have gone all of it without being seen
            delay = min(delay, _UNSEEN)
        return elapsed > self.motion.duration + delay

    def planned(self, elapsed: float) -> State:
        """Return position and velocity (n_joints,) of the reference, rad, rad/s; first at rest."""
        if self.delay is None:
            return self.motion.position[0], np.zeros_like(self.motion.velocity[0])
        sample = round((elapsed - self.delay) * self.motion.rate)
        sample = min(max(sample, 0), len(self.motion.position) - 1)
        return self.motion.position[sample], self.motion.velocity[sample]

    def _nearest(
        self, elapsed: float, position: FloatArray, low: float, high: float
    ) -> tuple[FloatArray, float]:
        """Return the planned position nearest to `position` of delays low … high, s; its delay."""
        delays = low + _STEP * np.arange(round((high - low) / _STEP) + 1)
        samples = np.round((elapsed - delays) * self.motion.rate).astype(int)
        samples = np.clip(samples, 0, len(self.motion.position) - 1)
        places = self.motion.position[samples]
        best = int(np.argmin(np.abs(places - position).max(axis=1)))
        return places[best], float(delays[best])


class HeardRobot:
    """The robot of a configuration file: its measured positions and its controller's references."""

    def __init__(self, node: Node, file: str) -> None:
        self.configuration = read_configuration(node, file)
        joints, signals = self.configuration.robot.joints, self.configuration.signals
        self.positions = JointPositions(node, signals.joint_states, joints)
        self.references: JointPositions | None = None
        if signals.reference is not None:
            self.references = JointPositions(node, signals.reference, joints, reference=True)

    @property
    def position(self) -> FloatArray:
        """Return the measured position (n_joints,) rad (m); joint states must have arrived."""
        assert self.positions.last is not None
        return self.positions.last.position

    def close(self) -> None:
        """Unsubscribe from the joint states and the references."""
        for topic in (self.positions, self.references):
            if topic is not None:
                topic.close()


@dataclass
class Collection:
    """Carries out one goal of the collector in a thread."""

    goal: Collect.Goal  # without zeros that stand for the node's parameters
    robot: HeardRobot
    controller: Controller
    recorder: RecorderNeighbour
    identifier: IdentifierNeighbour
    settings: Callable[[], CollectorSettings]
    gone: Callable[[], bool]  # whether no client waits for the result
    # Takes the stage, the share done, the largest tracking error of the stage and its joint.
    say: Callable[[str, float, float, str], None]

    def __post_init__(self) -> None:
        self.result = Collect.Result()
        self._deadline = time.monotonic() + self.goal.timeout
        self._cancelled = ""
        self._stage, self._worst, self._joint = "", 0.0, ""
        self._said = 0.0
        self._done, self._whole = 0.0, 1.0  # expected durations so far and in all, s
        self._trouble: Callable[[], str] = str  # another reason to end; empty: none

    def cancel(self, why: str) -> None:
        """Stop the robot and end the collection; may be called from any thread."""
        self._cancelled = self._cancelled or why

    def run(self) -> Collect.Result:
        """Carry out the goal, and return its result whatever happens."""
        try:
            self._run()
            self.result.success = True
        except IdimError as error:
            self.result.message = " ".join(str(error).split())
        except Exception as error:
            self.result.message = f"defect in idim_iv_ros ({one_line(error)})"
        return self.result

    def _run(self) -> None:
        goal = self.goal
        self._begin("looking for the robot")
        self._find()
        passes = self._plan()
        moves = [passes.approach.duration, passes.slow.duration, passes.full.duration]
        rest = sum(moves) + _CHECK + goal.identify * _IDENTIFICATION
        self._whole = rest / (1.0 - _PLANNING)
        self._done = self._whole - rest
        self._follow("moving to the start", passes.approach, passes)
        self._follow("slow pass", passes.slow, passes)
        bag = self._record(passes)
        self._begin("checking")
        report = self._compute(lambda look: check([bag], self.robot.configuration, look), _CHECK)
        self.result.usable = report.usable
        self.result.findings = [
            f"{finding.level}: {finding.where}: {finding.sentence}" for finding in report.findings
        ]
        if not report.usable:
            why = next(finding for finding in report.findings if finding.level == "unusable")
            raise DataError(f"{bag.name} cannot be identified: {why.where}: {why.sentence}")
        self.result.message = f"{bag.name}: {passes.full.duration:.3g} s recorded, usable"
        if goal.identify:
            self._identify(bag)

    def _find(self) -> None:
        """Wait until all nodes and joint states are there; raise UsageError if the robot moves."""
        wanted = [self.controller.missing, self.recorder.missing]
        wanted += [self.identifier.missing] if self.goal.identify else []
        positions, until = self.robot.positions, time.monotonic() + _DISCOVERY

        def problem() -> str:
            problems = [missing() for missing in wanted]
            if positions.age() > self.settings().stale_after:
                why = f" ({positions.problem})" if positions.problem else ""
                problems.append(f"no joint states of all joints on {positions.topic}{why}")
            return next(filter(None, problems), "")

        while problem():
            if time.monotonic() > until:
                raise UsageError(problem())
            self._tick()
        before = self.robot.position
        self._pause(_STANDING)
        if np.abs(self.robot.position - before).max() > _STILL:
            raise UsageError("the robot is moving: wait until it rests")

    def _plan(self) -> Passes:
        self._begin("planning")
        settings, goal, references = self.settings(), self.goal, self.robot.references
        model, limits, motion = self._compute(
            lambda look: plan_passes(
                self.robot.configuration,
                kind=cast(Kind, settings.motion),
                duration=goal.duration,
                speed_scale=goal.speed_scale,
                seed=goal.seed,
                floor=None if np.isnan(settings.floor) else settings.floor,
                progress=look,
            ),
            _PLANNING,
        )
        self._find()  # planning took a while
        # The controller's reference: the measured position differs by the steady-state error under
        # gravity, and a motion that began there would begin with a step of the reference.
        start = self.robot.position
        if references is not None and references.last is not None and references.age() <= 1.0:
            asked = references.last.position
            if np.abs(asked - start).max() < settings.tracking_error:
                start = asked
        return passes_of(
            model,
            limits,
            motion,
            start,
            approach_speed=min(settings.approach_speed / goal.speed_scale, 1.0),
            slow_speed=settings.slow_speed,
        )

    def _record(self, passes: Passes) -> Path:
        self.recorder.start(self._tick)
        try:
            self._trouble = self.recorder.trouble
            self._pause(_REST)
            self._follow("recording", passes.full, passes)
            self._pause(_REST)
        except Exception:
            with contextlib.suppress(IdimError):  # the first reason is the one to name
                self.result.bag = self.recorder.stop(aborted=True).name
            raise
        finally:
            self._trouble = str
        bag = self.recorder.stop()
        self.result.bag = bag.name
        return bag

    def _identify(self, bag: Path) -> None:
        self._begin("identifying")
        done = self._done

        def say(stage: str, share: float) -> None:
            self._done = done + share * _IDENTIFICATION
            if stage != self._stage:
                self._begin(stage)
            self._report_progress()

        try:
            answer = self.identifier.identify(bag, self.goal.estimator, say, self._tick)
            if not answer.success:
                raise DataError(answer.message)
        except IdimError as error:  # the bag is not lost with it
            raise DataError(f"{bag.name} is recorded and usable, but: {error}") from error
        self.result.result = answer.result
        self.result.message = f"{bag.name}: {answer.message}"

    def _follow(self, stage: str, motion: Trajectory, passes: Passes) -> None:
        """Move the robot along a motion; an IdimError says why it was stopped."""
        self._begin(stage)
        settings = self.settings()
        start = self.robot.position
        watch = Supervision(motion, start, settings.tracking_error, settings.start_delay)
        done, begun = self._done, time.monotonic()
        self.controller.follow(motion, settings.point_rate * motion.rate / passes.full.rate)
        try:
            problem, moving = self._watch(watch, begun, motion.duration)
        except Exception:  # a defect must not leave a robot to itself
            self._halt(motion, passes, watch.planned(time.monotonic() - begun))
            raise
        if problem:
            self._halt(motion, passes, moving)
            raise DataError(f"stopped in {stage}: {problem}")
        self._done = done + motion.duration

    def _watch(self, watch: Supervision, begun: float, duration: float) -> tuple[str, State]:
        """Supervise the robot until its motion is over or a problem occurs.

        Returns the problem (empty: none), and the position and velocity (n_joints,) to stop from.
        """
        settings, positions = self.settings(), self.robot.positions
        before, done = positions.last, self._done
        while not watch.ended(time.monotonic() - begun):
            time.sleep(LOOK)
            place, elapsed = positions.last, time.monotonic() - begun
            assert place is not None
            problem = self._reason_to_end() or self.controller.failure()
            if not problem and positions.age() > settings.stale_after:
                problem = f"no joint states on {positions.topic} for {positions.age():.2g} s"
            error, joint = watch.look(max(place.measured - begun, 0.0), place.position)
            if error > self._worst:
                self._worst, self._joint = error, joint
            if problem:
                return problem, watch.planned(elapsed)
            if error > settings.tracking_error:
                problem = (
                    f"{joint} is {error:.3g} from where it should be, more than "
                    f"tracking_error {settings.tracking_error:g}"
                )
                if watch.delay is None:
                    problem += "; the robot does not move: does its controller run?"
                speed = np.zeros_like(place.position)
                if before is not None and place.measured > before.measured:
                    speed = (place.position - before.position) / (place.measured - before.measured)
                return problem, (place.position, speed)
            if before is None or place.measured > before.measured + 2.0 * LOOK:
                before = place
            self._done = done + min(elapsed, duration)
            self._report_progress()
        return "", (self.robot.position, np.zeros_like(self.robot.position))

    def _halt(self, motion: Trajectory, passes: Passes, moving: State) -> None:
        """Stop the robot from a position and velocity, and wait until it rests."""
        self.controller.halt(stop(motion.joints, *moving, passes.limits))
        until = time.monotonic() + _SETTLED
        still = None
        while time.monotonic() < until and self.robot.positions.age() < _STANDING:
            time.sleep(_STANDING)
            here = self.robot.position
            if still is not None and np.abs(here - still).max() < _STILL:
                return
            still = here

    def _reason_to_end(self) -> str:
        if self._cancelled:
            return self._cancelled
        if not self.settings().allow_motion:
            return "allow_motion was set to false"
        if time.monotonic() > self._deadline:
            return f"not finished within {self.goal.timeout:g} s"
        return "who asked is gone" if self.gone() else self._trouble()

    def _tick(self) -> None:
        """Sleep for `LOOK` seconds, then report progress; a DataError says why to end."""
        time.sleep(LOOK)
        if reason := self._reason_to_end():
            raise DataError(reason)
        self._report_progress()

    def _pause(self, seconds: float) -> None:
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self._tick()

    def _compute(
        self, compute: Callable[[Callable[[str, float], None]], Result], expected: float
    ) -> Result:
        """Compute in another thread while this one ticks, so that a reason to end is noticed.

        `compute` takes a callback, which raises at the end; `expected` is its share of the whole.
        """
        begun = self._done
        given_up = threading.Event()

        def look(stage: str, share: float) -> None:
            if given_up.is_set():
                raise UsageError("given up")
            self._done = max(self._done, begun + share * expected)

        answer = in_thread(lambda: compute(look), "computation")
        try:
            while not answer.done():
                self._tick()
        except IdimError:
            given_up.set()
            raise
        self._done = begun + expected
        return answer.result()

    def _begin(self, stage: str) -> None:
        self._stage, self._worst, self._joint = stage, 0.0, ""
        self._said = -np.inf  # at once
        self._report_progress()

    def _report_progress(self) -> None:
        now = time.monotonic()
        if now > self._said + _SIGN_OF_LIFE:
            self._said = now
            self.say(self._stage, min(self._done / self._whole, 1.0), self._worst, self._joint)
