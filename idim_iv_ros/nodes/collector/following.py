"""A robot that follows a motion, is watched, and stopped when anything is wrong."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from idim_iv_ros.errors import DataError
from idim_iv_ros.excitation import Passes, Trajectory, stop
from idim_iv_ros.nodes.collector.controller import Controller
from idim_iv_ros.nodes.collector.course import LOOK, Course
from idim_iv_ros.nodes.collector.joint_positions import JointPositions
from idim_iv_ros.nodes.collector.settings import CollectorSettings
from idim_iv_ros.nodes.collector.supervision import Supervision
from idim_iv_ros.types import FloatArray

STANDING = 0.2  # s in which a robot at rest moves less than
STILL = 0.01  # rad (m)
_SETTLED = 3.0  # s until a robot that was stopped rests

State = tuple[FloatArray, FloatArray]


class Follower:
    """One robot: where it is, and what moves it."""

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
        """Where the robot is (n_joints,) rad (m); joint states must have come."""
        assert self._positions.last is not None
        return self._positions.last.position

    def follow(self, stage: str, motion: Trajectory, passes: Passes) -> None:
        """Have the robot go through a motion, and watch it.

        Raises
        ------
        IdimError
            The robot was stopped: one line says why.
        """
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
        """Look at the robot until it rests at the end, or there is a problem.

        Returns
        -------
        str
            The problem; empty at the end.
        State
            Position and velocity from which the robot can be stopped smoothly.
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
            deviation = watch.look(max(place.measured - begun, 0.0), place.position)
            self._course.deviates(deviation.size, deviation.joint)
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
            if before is None or place.measured > before.measured + 2.0 * LOOK:
                before = place
            self._course.proceed(done + min(elapsed, duration))
        return "", (self.position(), np.zeros_like(self.position()))

    def _halt(self, motion: Trajectory, passes: Passes, moving: State) -> None:
        """Bring the robot to rest from where it is and as fast as it moves."""
        self._controller.halt(stop(motion.joints, *moving, passes.limits))
        until = time.monotonic() + _SETTLED
        still = None
        while time.monotonic() < until and self._positions.age() < STANDING:
            time.sleep(STANDING)
            here = self.position()
            if still is not None and np.abs(here - still).max() < STILL:
                return
            still = here


def _speed(before: Any, now: Any) -> FloatArray:
    """Of two places, rad/s (m/s); zero where they are one."""
    if before is None or now.measured <= before.measured:
        return np.zeros_like(now.position)
    return np.asarray((now.position - before.position) / (now.measured - before.measured))
