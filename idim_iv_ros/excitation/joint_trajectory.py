"""A trajectory as a trajectory_msgs/msg/JointTrajectory in YAML, for ``ros2 topic pub``."""

from collections.abc import Iterable
from typing import TextIO

import numpy as np

from idim_iv_ros.errors import UsageError
from idim_iv_ros.excitation.trajectory import Trajectory


def write_joint_trajectory(trajectory: Trajectory, file: TextIO, *, rate: float) -> None:
    """Write the message; its points are every k-th sample and the last one.

    ``ros2 topic pub --once --yaml-file FILE TOPIC trajectory_msgs/msg/JointTrajectory`` and
    ``"$(cat FILE)"`` accept the text. A joint_trajectory_controller interpolates between the
    points (quintic splines where points have accelerations, as here).

    Parameters
    ----------
    rate
        Points per second; the nearest that divides the trajectory's rate is used.

    Raises
    ------
    UsageError
        `rate` is not between 0 and the rate of the trajectory.
    """
    require_message_rate(rate, trajectory.rate)
    samples = len(trajectory.position)
    kept = np.arange(0, samples, max(1, round(trajectory.rate / rate)))
    if kept[-1] != samples - 1:
        kept = np.append(kept, samples - 1)
    file.write("header: {stamp: {sec: 0, nanosec: 0}, frame_id: ''}\n")
    file.write(f"joint_names: [{', '.join(_quoted(name) for name in trajectory.joints)}]\n")
    file.write("points:\n")
    for sample in kept:
        nanoseconds = round(sample / trajectory.rate * 1e9)
        file.write(
            f"- {{positions: {_numbers(trajectory.position[sample])},\n"
            f"   velocities: {_numbers(trajectory.velocity[sample])},\n"
            f"   accelerations: {_numbers(trajectory.acceleration[sample])},\n"
            f"   effort: [], time_from_start: {{sec: {nanoseconds // 10**9}, "
            f"nanosec: {nanoseconds % 10**9}}}}}\n"
        )


def require_message_rate(points: float, samples: float) -> None:
    """Refuse a rate of points that is not above 0 and up to the rate of samples, per second.

    Raises
    ------
    UsageError
    """
    if not 0.0 < points <= samples:
        raise UsageError(
            f"{points:g} points per second: a rate above 0 and up to that of the trajectory, "
            f"{samples:g} per second, is needed"
        )


def _quoted(name: str) -> str:
    return "'" + name.replace("'", "''") + "'"


def _numbers(values: Iterable[float]) -> str:
    # A decimal point in every number: YAML would read 0 as an integer and 1e-05 as text.
    return "[" + ", ".join(f"{value + 0.0:.7f}" for value in values) + "]"
