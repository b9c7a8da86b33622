"""Motions of the simulated robot (approach, motion, rest), and their publication in real time."""

import struct
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicHermiteSpline, make_interp_spline

from idim_iv_ros.errors import UsageError, one_line
from idim_iv_ros.excitation.trajectory import Trajectory, quintic, shortest_quintic
from idim_iv_ros.recording.writing.write import JointTopic, serialised
from idim_iv_ros.simulators.recording import SimulatedRobot, recorded_topics
from idim_iv_ros.types import FloatArray

REST = 2.0  # s before and after a motion
_SHARE = 0.3  # of the speed limit, for the approach
_SPEED = 0.5  # rad/s (m/s) of the approach where the URDF has no limit
_LONGEST = 3600.0  # s
_BLEND = 0.3  # s at least, from one motion into the next

_STAMP = struct.Struct("<iI")
_PLACE = 4  # of the stamp in a message
_CATCH_UP = 0.5  # s that a thread that was held up makes good at most


def commanded(
    joints: Sequence[str],
    times: FloatArray,
    positions: FloatArray,
    velocities: FloatArray | None,
    rate: float,
) -> Trajectory:
    """Return the trajectory through the points of a JointTrajectory, sampled at `rate` Hz.

    `times` (n_points,), s; `positions`, `velocities` (n_points, n_joints), rad, rad/s; without
    velocities lines join them. Raises UsageError: the points are no valid trajectory.
    """
    numbers = [times, positions] + ([] if velocities is None else [velocities])
    if len(times) < 2:
        raise UsageError(f"joint_trajectory: {len(times)} points; at least 2 are needed")
    if not all(np.isfinite(number).all() for number in numbers):
        raise UsageError("joint_trajectory: a number is not finite")
    if times[0] < 0.0 or np.any(np.diff(times) <= 0.0):
        raise UsageError("joint_trajectory: time_from_start does not increase")
    if times[-1] - times[0] < 1.0 / rate:
        raise UsageError(f"joint_trajectory: shorter than one sample, {1.0 / rate:g} s")
    if times[-1] > _LONGEST:
        raise UsageError(f"joint_trajectory: longer than {_LONGEST:g} s")
    grid = np.arange(int((times[-1] - times[0]) * rate) + 1) / rate + times[0]
    if velocities is None:
        line = make_interp_spline(times, positions, k=1)
        position, velocity = line(grid), np.gradient(line(grid), 1.0 / rate, axis=0)
    else:
        curve = CubicHermiteSpline(times, positions, velocities)
        position, velocity = curve(grid), curve(grid, 1)
    return Trajectory(tuple(joints), rate, position, velocity, np.zeros_like(position))


@dataclass(frozen=True)
class MotionSimulation:
    """Simulates a robot along motions that begin and end at rest; `rate` of the references, Hz.

    A motion is returned as messages with times from zero, s, and references (n_samples, n_joints),
    rad (m), whose last REST seconds are at rest. `seed` is that of the noise.
    """

    robot: SimulatedRobot
    rate: float

    def published(
        self, start: FloatArray, trajectory: Trajectory | None, seed: int
    ) -> tuple[list[JointTopic], FloatArray]:
        """Simulate a trajectory (if any) after an approach from rest at `start` (n_joints,).

        Returns messages and references. Raises UsageError: the trajectory is for other joints or
        leaves their range. DataError: the closed loop diverged.
        """
        parts = [np.tile(start, (2, 1))]
        if trajectory is not None:
            motion = self._motion(trajectory).position
            way = motion[0] - start
            samples = round(max(0.5, self._seconds(way)) * self.rate) + 1
            # A polynomial of fifth order from rest to rest, slow against the speed limits.
            parts += [start + way * quintic(np.linspace(0.0, 1.0, samples)[:, None])[0], motion]
        return self._simulate(np.concatenate(parts), seed)

    def continued(
        self, history: FloatArray, elapsed: float, trajectory: Trajectory, seed: int
    ) -> tuple[list[JointTopic], FloatArray]:
        """Simulate the change to another trajectory, without its first `elapsed` seconds.

        `history` (n_samples, n_joints) are the references since the last rest, up to the change.
        """
        motion, rate = self._motion(trajectory), self.rate
        place, speed = history[-1], (history[-1] - history[-2]) * rate
        due = min(round(elapsed * rate), len(motion.position) - 1)
        seconds = max(_BLEND, self._seconds(motion.position[due] - place))
        samples = round(seconds * rate)
        target = min(due + samples, len(motion.position) - 1)
        arrival = motion.velocity[target] * (target < len(motion.position) - 1)
        ends = [place, motion.position[target]]
        blend = CubicHermiteSpline((0.0, samples / rate), ends, [speed, arrival])
        time = np.arange(1, samples + 1) / rate
        whole = np.concatenate([history, blend(time), motion.position[target + 1 :]])
        return self._simulate(whole, seed)

    def _simulate(self, position: FloatArray, seed: int) -> tuple[list[JointTopic], FloatArray]:
        """Simulate references (n_samples, n_joints), a rest added after them."""
        rest = round(REST * self.rate)
        whole = np.pad(position, ((rest, rest), (0, 0)), mode="edge")
        velocity = np.gradient(whole, 1.0 / self.rate, axis=0)
        joints = self.robot.robot.joints
        motion = Trajectory(joints, self.rate, whole, velocity, np.zeros_like(whole))
        topics = []
        for topic in recorded_topics(self.robot, self.robot.record(motion, seed)):
            # The loop begins unloaded and settles in the first rest, which nobody sees.
            rows = topic.time >= REST - 1e-9
            values = {name: getattr(topic, name) for name in ("position", "velocity", "effort")}
            later = {name: value[rows] for name, value in values.items() if value is not None}
            topics.append(replace(topic, time=topic.time[rows] - REST, **later))
        return topics, whole[rest:]

    def _seconds(self, way: FloatArray) -> float:
        """Return the duration, s, of a slow fifth-order polynomial over a distance (n_joints,)."""
        limit = self.robot.robot.limits.velocity
        speed = np.where(np.isfinite(limit), _SHARE * limit, _SPEED)
        return shortest_quintic(way, speed, np.full_like(speed, np.inf))

    def _motion(self, trajectory: Trajectory) -> Trajectory:
        """Return a trajectory in the robot's order of joints; a UsageError if beyond limits."""
        joints, limits = self.robot.robot.joints, self.robot.robot.limits
        motion = trajectory.in_order(joints)
        outside = (motion.position < limits.lower - 1e-9) | (motion.position > limits.upper + 1e-9)
        if outside.any():
            joint = joints[int(np.flatnonzero(outside.any(axis=0))[0])]
            raise UsageError(f"the trajectory leaves the range of {joint}")
        return motion


class Playback(threading.Thread):
    """Thread that publishes motions in real time, and between them the robot at rest.

    `resting` is the robot before its first motion; the last REST seconds of any motion are at rest.
    `publish` has a function for the messages of each topic; `clock` returns the time, ns.
    """

    def __init__(
        self,
        resting: Sequence[JointTopic],
        publish: Mapping[str, Callable[[bytes], None]],
        clock: Callable[[], int],
    ) -> None:
        super().__init__(name="playback", daemon=True)
        self._motion = _Motion(resting)
        self.failure = ""  # why messages could not be published
        self._publish, self._clock = publish, clock
        self._next: _Motion | None = None
        self._goes_on = False  # whether the next motion is equal to the present one up to now
        self._sample = 0
        self._lock = threading.Lock()
        self._moving = False
        self._ended = threading.Event()

    @property
    def moving(self) -> bool:
        """Return whether a motion is under way or queued."""
        return self._moving or self._next is not None

    def play(self, topics: Sequence[JointTopic]) -> None:
        """Queue a motion that begins at rest, after the present one."""
        with self._lock:
            self._next, self._goes_on = _Motion(topics), False

    def change(self, seconds: float) -> int | None:
        """Return the sample that is due `seconds` from now; None if the robot then rests."""
        while self._next is not None and self.is_alive():
            time.sleep(0.001)  # until it is the present one
        with self._lock:
            sample = self._sample + max(1, round(seconds / self._motion.period))
            rests = sample >= self._motion.at_rest(2.0 * REST)
            return sample if self._moving and not rests else None

    def replace(self, topics: Sequence[JointTopic], sample: int) -> bool:
        """Switch at `sample` to a motion that is equal up to there; False if that is past."""
        new = _Motion(topics)
        with self._lock:
            if not self._moving or self._sample >= sample:
                return False
            self._next, self._goes_on = new, True
            return True

    def end(self) -> None:
        """End the thread."""
        self._ended.set()
        self.join()

    def run(self) -> None:
        """Publish until `end`."""
        first, begin = 0, time.monotonic()
        while not self._ended.is_set():
            with self._lock:
                if self._next is not None:
                    self._motion, self._next = self._next, None
                    first, self._moving = self._sample if self._goes_on else 0, True
                else:
                    first, self._moving = self._motion.at_rest(REST), False
            begin = max(self._pass(self._motion, first, begin), time.monotonic() - _CATCH_UP)

    def _pass(self, motion: "_Motion", first: int, begin: float) -> float:
        """Publish from sample `first` on, until another motion may begin; return that time, s."""
        base = self._clock() - int((time.monotonic() - begin) * 1e9)
        resting = motion.at_rest(REST)
        for sample in range(first, motion.samples):
            due = begin + (sample - first) * motion.period
            ahead = due - time.monotonic()
            if ahead > 0:
                time.sleep(ahead)
            with self._lock:
                self._sample = sample
                rests = not self._moving or sample >= resting
                leave = self._next is not None and (rests or self._goes_on)
            if self._ended.is_set():
                return time.monotonic()
            if leave:
                return due
            try:
                for topic, message in motion.stamped(sample, first, base):
                    self._publish[topic](message)
            except Exception as error:  # the next message may pass
                self.failure = one_line(error)
        return begin + (motion.samples - first) * motion.period


class _Motion:
    """A motion as serialised messages of all topics, sample by sample."""

    def __init__(self, topics: Sequence[JointTopic]) -> None:
        self.samples = min(len(topic.time) for topic in topics)
        reference = topics[-1].time if len(topics) > 1 else topics[0].time
        self.period = float(np.mean(np.diff(reference)))
        zero = np.zeros(self.samples, dtype=np.int64)
        self._topics = [
            (topic.name, serialised(topic, zero), np.round(topic.time * 1e9).astype(int).tolist())
            for topic in topics
        ]

    def at_rest(self, seconds: float) -> int:
        """Return the first sample of the last half of the last `seconds` of the motion."""
        return max(0, self.samples - round(0.5 * seconds / self.period))

    def stamped(self, sample: int, first: int, base: int) -> Iterator[tuple[str, bytes]]:
        """Yield topic and message of one sample; `base` is the time of sample `first`, ns."""
        for topic, messages, stamps in self._topics:
            stamp = base + stamps[sample] - stamps[first]
            message = bytearray(messages[sample].tobytes())
            _STAMP.pack_into(message, _PLACE, *divmod(stamp, 1_000_000_000))
            yield topic, bytes(message)
