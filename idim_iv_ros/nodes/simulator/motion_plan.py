"""What the simulated robot is asked for: approach, motion, rest; and what it then publishes."""

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicHermiteSpline, make_interp_spline

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import UsageError
from idim_iv_ros.excitation import Trajectory
from idim_iv_ros.recording import JointTopic
from idim_iv_ros.simulators.recording import recorded_topics
from idim_iv_ros.simulators.robot import SimulatedRobot
from idim_iv_ros.types import FloatArray

REST = 2.0  # s before and after a motion
_SHARE = 0.3  # of the speed limit, for the approach
_SPEED = 0.5  # rad/s (m/s) of the approach where the URDF has no limit
_LONGEST = 3600.0  # s


def commanded(
    joints: Sequence[str],
    times: FloatArray,
    positions: FloatArray,
    velocities: FloatArray | None,
    rate: float,
) -> Trajectory:
    """Return the uniform trajectory through the points of a JointTrajectory.

    Parameters
    ----------
    joints
    times
        (n_points,) s from the start.
    positions, velocities
        (n_points, n_joints) rad, rad/s; without velocities the points are joined by straight
        lines.
    rate
        Samples per second.

    Raises
    ------
    UsageError
        Fewer than two points, times that do not increase, numbers that are not finite, or a
        motion of less than a sample or more than an hour.
    """
    numbers = [times, positions] + ([] if velocities is None else [velocities])
    if len(times) < 2:
        raise UsageError(f"joint_trajectory: {len(times)} points; at least 2 are needed")
    if not all(np.isfinite(each).all() for each in numbers):
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


def published(
    configuration: Configuration,
    robot: SimulatedRobot,
    rate: float,
    start: FloatArray,
    trajectory: Trajectory | None,
    seed: int,
) -> tuple[list[JointTopic], FloatArray]:
    """Run the simulated robot from rest at `start` through a trajectory to rest.

    Parameters
    ----------
    configuration, robot
    rate
        Of the references, Hz.
    start
        (n_joints,) reference at which it rests.
    trajectory
        None: it stays where it is.
    seed
        Of the noise.

    Returns
    -------
    list of JointTopic, (n_joints,)
        Messages with times from zero; the last REST seconds are at rest, at the reference that
        stands beside them.

    Raises
    ------
    UsageError
        The trajectory is for other joints or leaves their range.
    DataError
        The closed loop diverged.
    """
    joints = robot.robot.joints
    rest = round(REST * rate)
    parts = [np.tile(start, (rest, 1))]
    if trajectory is not None:
        motion = trajectory.in_order(joints).position
        _require_range(robot, motion)
        parts += [_approach(robot, start, motion[0], rate), motion]
    end = parts[-1][-1]
    parts.append(np.tile(end, (rest, 1)))
    position = np.concatenate(parts)
    velocity = np.gradient(position, 1.0 / rate, axis=0)
    whole = Trajectory(tuple(joints), rate, position, velocity, np.zeros_like(position))
    topics = recorded_topics(configuration, robot, robot.record(whole, seed))
    # The loop begins unloaded and settles in the first rest, which nobody sees.
    return [_without(topic, REST) for topic in topics], end


def _approach(robot: SimulatedRobot, start: FloatArray, end: FloatArray, rate: float) -> FloatArray:
    """Fifth-order polynomial from rest to rest, slow against the speed limits."""
    limit = robot.robot.limits.velocity
    speed = np.where(np.isfinite(limit), _SHARE * limit, _SPEED)
    duration = max(0.5, 1.875 * float(np.max(np.abs(end - start) / speed)))
    s = np.linspace(0.0, 1.0, round(duration * rate) + 1)[:, None]
    return np.asarray(start + (end - start) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2))


def _require_range(robot: SimulatedRobot, motion: FloatArray) -> None:
    limits = robot.robot.limits
    outside = (motion < limits.lower - 1e-9) | (motion > limits.upper + 1e-9)
    if outside.any():
        joint = robot.robot.joints[int(np.flatnonzero(outside.any(axis=0))[0])]
        raise UsageError(f"the trajectory leaves the range of {joint}")


def _without(topic: JointTopic, seconds: float) -> JointTopic:
    """Leave the beginning out."""
    kept = topic.time >= seconds - 1e-9

    def part(values: FloatArray | None) -> FloatArray | None:
        return None if values is None else values[kept]

    return JointTopic(
        topic.name,
        topic.joints,
        topic.time[kept] - seconds,
        part(topic.position),
        part(topic.velocity),
        part(topic.effort),
    )
