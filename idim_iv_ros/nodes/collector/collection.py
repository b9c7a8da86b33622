"""One goal: plan, move, record, check, identify; and stop the robot when anything is wrong.

Runs in a thread of its own; what it needs from ROS comes through its parts.
"""

import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import DataError, IdimError, UsageError, one_line
from idim_iv_ros.excitation import Passes, passes_of, plan_passes
from idim_iv_ros.excitation.passes import Kind
from idim_iv_ros.identification.check import CheckReport, check
from idim_iv_ros.nodes.collector.controller import Controller
from idim_iv_ros.nodes.collector.course import Course, Say, wait_whatever_happens
from idim_iv_ros.nodes.collector.following import STANDING, STILL, Follower
from idim_iv_ros.nodes.collector.joint_positions import JointPositions
from idim_iv_ros.nodes.collector.neighbours import IdentifierNeighbour, RecorderNeighbour
from idim_iv_ros.nodes.collector.settings import CollectorSettings
from idim_iv_ros.types import FloatArray

_REST = 0.5  # s that are recorded before and after the motion
_DISCOVERY = 3.0  # s that a neighbour may need to be found
_CHECK, _IDENTIFICATION = 5.0, 20.0  # s, about, for the share that is done
_PLANNING = 0.1  # of the whole, whose duration is known only afterwards


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
        See `Course`.
    """

    def __init__(self, order: Order, parts: Parts, say: Say) -> None:
        self._order, self._parts = order, parts
        settings = parts.settings
        self._course = Course(order.timeout, lambda: settings().allow_motion, parts.gone, say)
        self._robot = Follower(parts.positions, parts.controller, settings, self._course)
        self.collected = Collected()

    def cancel(self, why: str) -> None:
        """Stop the robot and end; in any thread."""
        self._course.cancel(why)

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
        self._course.begin("looking for the robot")
        wanted = [parts.controller.missing, parts.recorder.missing]
        wanted += [parts.identifier.missing] if order.identify else []
        self._find(wanted)
        passes = self._plan(lambda: self._find(wanted))
        moves = [passes.approach.duration, passes.slow.duration, passes.full.duration]
        rest = sum(moves) + _CHECK + order.identify * _IDENTIFICATION
        self._course.whole = rest / (1.0 - _PLANNING)
        self._course.done = self._course.whole - rest
        self._robot.follow("moving to the start", passes.approach, passes)
        self._robot.follow("slow pass", passes.slow, passes)
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
                why = f" ({parts.positions.problem})" if parts.positions.problem else ""
                problems.append(f"no joint states of all joints on {parts.positions.topic}{why}")
            return next(filter(None, problems), "")

        while problem():
            if time.monotonic() > until:
                raise UsageError(problem())
            self._course.tick()
        before = self._robot.position()
        self._course.pause(STANDING)
        if np.abs(self._robot.position() - before).max() > STILL:
            raise UsageError("the robot is moving: wait until it rests")

    def _plan(self, find: Callable[[], None]) -> Passes:
        self._course.begin("planning")
        settings, order = self._parts.settings(), self._order
        model, limits, motion = self._course.compute(
            lambda look: plan_passes(
                self._parts.configuration,
                kind=cast(Kind, settings.motion),
                duration=order.duration,
                speed_scale=order.speed_scale,
                seed=order.seed,
                floor=None if np.isnan(settings.floor) else settings.floor,
                progress=look,
            ),
            _PLANNING,
        )
        find()  # that took its time
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
        here = self._robot.position()
        if references is None or references.last is None or references.age() > 1.0:
            return here
        held = references.last.position
        return held if np.abs(held - here).max() < settings.tracking_error else here

    def _record(self, passes: Passes) -> Path:
        self._parts.recorder.start(self._course.wait)
        try:
            self._course.trouble = self._parts.recorder.trouble
            self._course.pause(_REST)
            self._robot.follow("recording", passes.full, passes)
            self._course.pause(_REST)
        except Exception:
            self._course.trouble = str
            with contextlib.suppress(IdimError):  # the first reason is the one to name
                self._close_bag(aborted=True)
            raise
        self._course.trouble = str
        return self._close_bag()

    def _close_bag(self, *, aborted: bool = False) -> Path:
        bag = self._parts.recorder.stop(wait_whatever_happens, aborted=aborted)
        self.collected.bag = bag.name
        return bag

    def _check(self, bag: Path) -> CheckReport:
        self._course.begin("checking")
        report = self._course.compute(
            lambda look: check([bag], self._parts.configuration, look), _CHECK
        )
        self.collected.usable = report.usable
        self.collected.findings = [
            f"{each.level}: {each.where}: {each.sentence}" for each in report.findings
        ]
        return report

    def _identify(self, bag: Path) -> None:
        self._course.begin("identifying")
        done = self._course.done

        def say(stage: str, share: float) -> None:
            self._course.proceed(done + share * _IDENTIFICATION, stage)

        try:
            answer = self._parts.identifier.identify(
                bag, self._order.estimator, say, self._course.wait
            )
            if not answer.success:
                raise DataError(answer.message)
        except IdimError as error:  # the bag is not lost with it
            raise DataError(f"{bag.name} is recorded and usable, but: {error}") from error
        self.collected.result = answer.result
        self.collected.message = f"{bag.name}: {answer.message}"
