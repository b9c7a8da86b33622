"""One goal of the collector: plan, move, record, check, identify; stop the robot on any fault.

The collection runs in a thread; its access to ROS is given to it as `Parts`.
"""

import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
from rclpy.node import Node

from idim_iv_interfaces.action import Collect
from idim_iv_ros.errors import DataError, IdimError, UsageError, one_line
from idim_iv_ros.excitation.excite import Kind, Passes, passes_of, plan_passes
from idim_iv_ros.identification.check import CheckReport, check
from idim_iv_ros.nodes.collector.following import STANDING, STILL, Course, Follower, Say
from idim_iv_ros.nodes.collector.neighbours import (
    Controller,
    IdentifierNeighbour,
    RecorderNeighbour,
)
from idim_iv_ros.nodes.joint_topic import JointPositions
from idim_iv_ros.nodes.parameters import read_configuration
from idim_iv_ros.nodes.settings import CollectorSettings
from idim_iv_ros.types import FloatArray

_REST = 0.5  # s that are recorded before and after the motion
_DISCOVERY = 3.0  # s until a node must be discovered
_CHECK, _IDENTIFICATION = 5.0, 20.0  # s, about, for the progress
_PLANNING = 0.1  # share of the progress: the duration is known only afterwards


class HeardRobot:
    """The robot of a configuration file: its measured positions and its controller's references."""

    def __init__(self, node: Node, file: str) -> None:
        self.configuration = read_configuration(node, file)
        joints, signals = self.configuration.robot.joints, self.configuration.signals
        self.positions = JointPositions(node, signals.joint_states, joints)
        self.references: JointPositions | None = None
        if signals.reference is not None:
            self.references = JointPositions(node, signals.reference, joints, reference=True)

    def close(self) -> None:
        """Unsubscribe from the joint states and the references."""
        for topic in (self.positions, self.references):
            if topic is not None:
                topic.close()


@dataclass(frozen=True)
class Parts:
    """Everything a collection needs; `gone` returns whether no client waits for its result."""

    robot: HeardRobot
    controller: Controller
    recorder: RecorderNeighbour
    identifier: IdentifierNeighbour
    settings: Callable[[], CollectorSettings]
    gone: Callable[[], bool]


class Collection:
    """Carries out one goal of the collector; `say` is the callback of `Course`.

    In the goal, zeros that stand for the node's parameters are already replaced by their values.
    """

    def __init__(self, goal: Collect.Goal, parts: Parts, say: Say) -> None:
        self._goal, self._parts = goal, parts
        settings = parts.settings
        self._course = Course(goal.timeout, lambda: settings().allow_motion, parts.gone, say)
        self._robot = Follower(parts.robot.positions, parts.controller, settings, self._course)
        self.result = Collect.Result()

    def cancel(self, why: str) -> None:
        """Stop the robot and end the collection; may be called from any thread."""
        self._course.cancel(why)

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
        parts, goal = self._parts, self._goal
        self._course.begin("looking for the robot")
        wanted = [parts.controller.missing, parts.recorder.missing]
        wanted += [parts.identifier.missing] if goal.identify else []
        self._find(wanted)
        passes = self._plan(lambda: self._find(wanted))
        moves = [passes.approach.duration, passes.slow.duration, passes.full.duration]
        rest = sum(moves) + _CHECK + goal.identify * _IDENTIFICATION
        self._course.whole = rest / (1.0 - _PLANNING)
        self._course.done = self._course.whole - rest
        self._robot.follow("moving to the start", passes.approach, passes)
        self._robot.follow("slow pass", passes.slow, passes)
        bag = self._record(passes)
        report = self._check(bag)
        if not report.usable:
            why = next(finding for finding in report.findings if finding.level == "unusable")
            raise DataError(f"{bag.name} cannot be identified: {why.where}: {why.sentence}")
        self.result.message = f"{bag.name}: {passes.full.duration:.3g} s recorded, usable"
        if goal.identify:
            self._identify(bag)

    def _find(self, wanted: list[Callable[[], str]]) -> None:
        """Wait until all nodes and joint states are there; raise UsageError if the robot moves."""
        positions, settings = self._parts.robot.positions, self._parts.settings
        until = time.monotonic() + _DISCOVERY

        def problem() -> str:
            problems = [missing() for missing in wanted]
            if positions.age() > settings().stale_after:
                why = f" ({positions.problem})" if positions.problem else ""
                problems.append(f"no joint states of all joints on {positions.topic}{why}")
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
        settings, goal = self._parts.settings(), self._goal
        model, limits, motion = self._course.compute(
            lambda look: plan_passes(
                self._parts.robot.configuration,
                kind=cast(Kind, settings.motion),
                duration=goal.duration,
                speed_scale=goal.speed_scale,
                seed=goal.seed,
                floor=None if np.isnan(settings.floor) else settings.floor,
                progress=look,
            ),
            _PLANNING,
        )
        find()  # planning took a while
        return passes_of(
            model,
            limits,
            motion,
            self._asked_position(),
            approach_speed=min(settings.approach_speed / goal.speed_scale, 1.0),
            slow_speed=settings.slow_speed,
        )

    def _asked_position(self) -> FloatArray:
        """Return the controller's reference (n_joints,), rad (m), else the measured position.

        The two differ by the steady-state error under gravity: a motion that began at the measured
        position would begin with a step of the reference.
        """
        settings, references = self._parts.settings(), self._parts.robot.references
        here = self._robot.position()
        if references is None or references.last is None or references.age() > 1.0:
            return here
        asked = references.last.position
        return asked if np.abs(asked - here).max() < settings.tracking_error else here

    def _record(self, passes: Passes) -> Path:
        self._parts.recorder.start(self._course.tick)
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
        bag = self._parts.recorder.stop(aborted=aborted)
        self.result.bag = bag.name
        return bag

    def _check(self, bag: Path) -> CheckReport:
        self._course.begin("checking")
        report = self._course.compute(
            lambda look: check([bag], self._parts.robot.configuration, look), _CHECK
        )
        self.result.usable = report.usable
        self.result.findings = [
            f"{finding.level}: {finding.where}: {finding.sentence}" for finding in report.findings
        ]
        return report

    def _identify(self, bag: Path) -> None:
        self._course.begin("identifying")
        done = self._course.done

        def say(stage: str, share: float) -> None:
            self._course.proceed(done + share * _IDENTIFICATION, stage)

        try:
            answer = self._parts.identifier.identify(
                bag, self._goal.estimator, say, self._course.tick
            )
            if not answer.success:
                raise DataError(answer.message)
        except IdimError as error:  # the bag is not lost with it
            raise DataError(f"{bag.name} is recorded and usable, but: {error}") from error
        self.result.result = answer.result
        self.result.message = f"{bag.name}: {answer.message}"
