"""One goal: plan, move, record, check, identify; and stop the robot when anything is wrong.

Runs in a thread of its own and looks at the robot fifty times a second; what it needs from ROS
comes through its parts.
"""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import DataError, IdimError, UsageError, one_line
from idim_iv_ros.excitation import Passes, Trajectory, passes_of, plan_passes, stop
from idim_iv_ros.excitation.passes import Kind
from idim_iv_ros.identification.check import CheckReport, check
from idim_iv_ros.nodes.collector.controller import Controller
from idim_iv_ros.nodes.collector.joint_positions import JointPositions
from idim_iv_ros.nodes.collector.neighbours import IdentifierNeighbour, RecorderNeighbour
from idim_iv_ros.nodes.collector.settings import CollectorSettings
from idim_iv_ros.nodes.collector.supervision import Supervision
from idim_iv_ros.types import FloatArray

_LOOK = 0.02  # s between two looks at the robot
_SIGN_OF_LIFE = 0.5  # s between two words on what is done
_REST = 0.5  # s that are recorded before and after the motion
_STANDING = 0.2  # s in which a robot at rest moves less than
_STILL = 0.01  # rad (m)
_SETTLED = 3.0  # s until a robot that was stopped rests
_DISCOVERY = 3.0  # s that a neighbour may need to be found
_CHECK, _IDENTIFICATION = 5.0, 20.0  # s, about, for the share that is done

Answer = TypeVar("Answer")
Say = Callable[[str, float, float, str], None]


@dataclass(frozen=True)
class Order:
    """What is asked for, defaults filled in: see Collect.action."""

    duration: float
    speed_scale: float
    seed: int
    identify: bool
    estimator: str
    timeout: float


@dataclass(frozen=True)
class Parts:
    """What a collection works with; `gone` says whether nobody waits for it any more."""

    configuration: Configuration
    positions: JointPositions
    references: JointPositions | None
    controller: Controller
    recorder: RecorderNeighbour
    identifier: IdentifierNeighbour
    settings: Callable[[], CollectorSettings]
    gone: Callable[[], bool]


@dataclass
class Collected:
    """What came of it; `result` is the message of the identification."""

    success: bool = False
    message: str = ""
    bag: str = ""
    usable: bool = False
    findings: list[str] = field(default_factory=list)
    result: Any = None


class Collection:
    """Does one order, once.

    Parameters
    ----------
    order
    parts
    say
        Takes stage, share done, largest tracking error so far in the stage and its joint.
    """

    def __init__(self, order: Order, parts: Parts, say: Say) -> None:
        self._order, self._parts, self._say = order, parts, say
        self._deadline = time.monotonic() + order.timeout
        self._cancelled = ""
        self._stage, self._worst, self._joint = "", 0.0, ""
        self._done, self._whole = 0.0, 1.0
        self._said = 0.0
        self.collected = Collected()

    def cancel(self, why: str) -> None:
        """Stop the robot and end; in any thread."""
        self._cancelled = self._cancelled or why

    def run(self) -> Collected:
        """Do it all, and return what came of it whatever happens."""
        try:
            self._run()
            self.collected.success = True
        except IdimError as error:
            self.collected.message = " ".join(str(error).split())
        except Exception as error:
            self.collected.message = f"defect in idim_iv_ros ({one_line(error)})"
        return self.collected

    def _run(self) -> None:
        parts, order = self._parts, self._order
        self._begin("looking for the robot")
        wanted = [parts.controller.missing, parts.recorder.missing]
        wanted += [parts.identifier.missing] if order.identify else []
        self._find(wanted)
        passes = self._plan()
        moves = [passes.approach.duration, passes.slow.duration, passes.full.duration]
        self._whole = sum(moves) + _CHECK + order.identify * _IDENTIFICATION
        self._follow("moving to the start", passes.approach, passes)
        self._follow("slow pass", passes.slow, passes)
        bag = self._record(passes)
        report = self._check(bag)
        if not report.usable:
            why = next(each for each in report.findings if each.level == "unusable")
            raise DataError(f"{bag.name} cannot be identified: {why.where}: {why.sentence}")
        self.collected.message = f"{bag.name}: {passes.full.duration:.3g} s recorded, usable"
        if order.identify:
            self._identify(bag)

    def _find(self, wanted: list[Callable[[], str]]) -> None:
        """Wait a little for those who take part, and for a robot that stands still."""
        parts = self._parts
        until = time.monotonic() + _DISCOVERY

        def problem() -> str:
            problems = [missing() for missing in wanted]
            if parts.positions.age() > parts.settings().stale_after:
                problems.append(f"no joint states of all joints on {parts.positions.topic}")
            return next(filter(None, problems), "")

        while problem():
            if time.monotonic() > until:
                raise UsageError(problem())
            self._tick()
        before = self._position()
        self._pause(_STANDING)
        if np.abs(self._position() - before).max() > _STILL:
            raise UsageError("the robot is moving: wait until it rests")

    def _plan(self) -> Passes:
        self._begin("planning")
        settings, order = self._parts.settings(), self._order
        model, limits, motion = self._computed(
            lambda look: plan_passes(
                self._parts.configuration,
                kind=cast(Kind, settings.motion),
                duration=order.duration,
                speed_scale=order.speed_scale,
                seed=order.seed,
                floor=None if np.isnan(settings.floor) else settings.floor,
                progress=look,
            )
        )
        return passes_of(
            model,
            limits,
            motion,
            self._asked_position(),
            approach_speed=min(settings.approach_speed / order.speed_scale, 1.0),
            slow_speed=settings.slow_speed,
        )

    def _asked_position(self) -> FloatArray:
        """Where the controller holds the robot, if it says so, else where the robot is.

        The two differ by what the weight of the arm pulls it down: a motion that began at the other
        would begin with a step.
        """
        settings, references = self._parts.settings(), self._parts.references
        here = self._position()
        if references is None or references.last is None or references.age() > 1.0:
            return here
        held = references.last.position
        return held if np.abs(held - here).max() < settings.tracking_error else here

    def _follow(self, stage: str, motion: Trajectory, passes: Passes) -> None:
        """Have the robot go through a motion, and watch it.

        Raises
        ------
        IdimError
            The robot was stopped: one line says why.
        """
        self._begin(stage)
        settings = self._parts.settings()
        watch = Supervision(motion, self._position(), settings.tracking_error, settings.start_delay)
        done, begun = self._done, time.monotonic()
        self._parts.controller.follow(motion, settings.point_rate * motion.rate / passes.full.rate)
        try:
            problem, moving = self._watch(watch, begun, motion.duration)
        except Exception:  # a defect must not leave a robot to itself
            self._halt(motion, passes, watch.planned(time.monotonic() - begun))
            raise
        if problem:
            self._halt(motion, passes, moving)
            raise DataError(f"stopped in {stage}: {problem}")
        self._done = done + motion.duration

    def _watch(
        self, watch: Supervision, begun: float, duration: float
    ) -> tuple[str, tuple[FloatArray, FloatArray]]:
        """Look at the robot until it rests at the end, or there is a problem.

        Returns
        -------
        str
            The problem; empty at the end.
        tuple of (n_joints,)
            Position and velocity from which the robot can be stopped smoothly.
        """
        settings, positions = self._parts.settings(), self._parts.positions
        before, done = positions.last, self._done
        while not watch.ended(time.monotonic() - begun):
            time.sleep(_LOOK)
            place, elapsed = positions.last, time.monotonic() - begun
            assert place is not None
            problem = self._reason_to_end() or self._parts.controller.failure()
            if not problem and positions.age() > settings.stale_after:
                problem = f"no joint states on {positions.topic} for {positions.age():.2g} s"
            deviation = watch.look(max(place.heard - begun, 0.0), place.position)
            if deviation.size > self._worst:
                self._worst, self._joint = deviation.size, deviation.joint
            if problem:
                return problem, watch.planned(elapsed)
            if deviation.size > settings.tracking_error:
                problem = (
                    f"{deviation.joint} is {deviation.size:.3g} from where it should be, more than "
                    f"tracking_error {settings.tracking_error:g}"
                )
                if watch.delay is None:
                    problem += "; the robot does not move: does its controller run?"
                return problem, (place.position, _speed(before, place))
            if before is None or place.heard > before.heard + 2.0 * _LOOK:
                before = place
            self._done = done + min(elapsed, duration)
            self._speak()
        return "", (self._position(), np.zeros_like(self._position()))

    def _halt(
        self, motion: Trajectory, passes: Passes, moving: tuple[FloatArray, FloatArray]
    ) -> None:
        """Bring the robot to rest from where it is and as fast as it moves."""
        self._parts.controller.halt(stop(motion.joints, *moving, passes.limits))
        until = time.monotonic() + _SETTLED
        still = None
        while time.monotonic() < until and self._parts.positions.age() < _STANDING:
            time.sleep(_STANDING)
            here = self._position()
            if still is not None and np.abs(here - still).max() < _STILL:
                return
            still = here

    def _record(self, passes: Passes) -> Path:
        recorder = self._parts.recorder
        recorder.start(self._wait)
        bag = None
        try:
            self._pause(_REST)
            self._follow("recording", passes.full, passes)
            self._pause(_REST)
        finally:
            bag = recorder.stop(_uninterrupted)
            self.collected.bag = bag.name
        return bag

    def _check(self, bag: Path) -> CheckReport:
        self._begin("checking")
        report = self._computed(lambda look: check([bag], self._parts.configuration, look))
        self.collected.usable = report.usable
        self.collected.findings = [
            f"{each.level}: {each.where}: {each.sentence}" for each in report.findings
        ]
        self._done += _CHECK
        return report

    def _identify(self, bag: Path) -> None:
        self._begin("identifying")
        done = self._done

        def say(stage: str, share: float) -> None:
            self._done = done + share * _IDENTIFICATION
            self._stage = stage
            self._speak(at_once=True)

        answer = self._parts.identifier.identify(bag, self._order.estimator, say, self._wait)
        if not answer.success:
            raise DataError(f"{bag.name} is recorded and usable, but: {answer.message}")
        self.collected.result = answer.result
        self.collected.message = f"{bag.name}: {answer.message}"

    def _position(self) -> FloatArray:
        assert self._parts.positions.last is not None
        return self._parts.positions.last.position

    def _computed(self, compute: Callable[[Callable[[str, float], None]], Answer]) -> Answer:
        """Compute in another thread, so that what happens meanwhile is noticed."""
        answers: list[Answer] = []
        errors: list[Exception] = []
        given_up = threading.Event()

        def look(stage: str, share: float) -> None:
            if given_up.is_set():
                raise UsageError("given up")

        def work() -> None:
            try:
                answers.append(compute(look))
            except Exception as error:
                errors.append(error)

        thread = threading.Thread(target=work, name="computation", daemon=True)
        thread.start()
        try:
            while thread.is_alive():
                self._tick()
        except IdimError:
            given_up.set()
            raise
        if errors:
            raise errors[0]
        return answers[0]

    def _wait(self, holds: Callable[[], bool], seconds: float, what: str) -> None:
        until = time.monotonic() + seconds
        while not holds():
            self._tick()
            if time.monotonic() > until:
                raise UsageError(f"{what} did not come within {seconds:g} s")

    def _pause(self, seconds: float) -> None:
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self._tick()

    def _tick(self) -> None:
        """Wait for a look; raise where the collection is to end."""
        time.sleep(_LOOK)
        reason = self._reason_to_end()
        if reason:
            raise DataError(reason)
        self._speak()

    def _reason_to_end(self) -> str:
        if self._cancelled:
            return self._cancelled
        if not self._parts.settings().allow_motion:
            return "allow_motion was set to false"
        if time.monotonic() > self._deadline:
            return f"not finished within {self._order.timeout:g} s"
        if self._parts.gone():
            return "who asked is gone"
        return ""

    def _begin(self, stage: str) -> None:
        self._stage, self._worst, self._joint = stage, 0.0, ""
        self._speak(at_once=True)

    def _speak(self, at_once: bool = False) -> None:
        now = time.monotonic()
        if at_once or now > self._said + _SIGN_OF_LIFE:
            self._said = now
            share = min(self._done / self._whole, 1.0)
            self._say(self._stage, share, self._worst, self._joint)


def _uninterrupted(holds: Callable[[], bool], seconds: float, what: str) -> None:
    """Wait whatever happens: a bag that is open has to be closed."""
    until = time.monotonic() + seconds
    while not holds():
        time.sleep(_LOOK)
        if time.monotonic() > until:
            raise UsageError(f"{what} did not come within {seconds:g} s")


def _speed(before: Any, now: Any) -> FloatArray:
    """Of two places, rad/s (m/s); zero where they are one."""
    if before is None or now.heard <= before.heard:
        return np.zeros_like(now.position)
    return np.asarray((now.position - before.position) / (now.heard - before.heard))
