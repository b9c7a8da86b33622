"""The way of a robot through a motion: slowly to its start, a slow pass, then at full speed."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import UsageError
from idim_iv_ros.excitation.design import DesignSettings, design_excitation
from idim_iv_ros.excitation.excite import load_model, random_motion
from idim_iv_ros.excitation.limits import MotionLimits, limit_use, motion_limits
from idim_iv_ros.excitation.trajectory import Trajectory, quintic, shortest_quintic
from idim_iv_ros.model import InverseModel
from idim_iv_ros.progress import Progress
from idim_iv_ros.types import FloatArray

Kind = Literal["designed", "random"]

_PERIOD = 10.0  # s; longer motions repeat a period
_LONGEST_SEARCH = 300.0  # s; searches end by themselves long before
_RATE = 1000.0  # samples per second
_SHORTEST = 0.5  # s of an approach


@dataclass(frozen=True)
class Passes:
    """What a robot is asked for, one after the other; it rests in between."""

    limits: MotionLimits  # Of the robot, with speed and acceleration scaled
    approach: Trajectory  # To the start of the motion
    slow: Trajectory  # Through it slowly
    full: Trajectory  # Through it at full speed


def plan_passes(
    configuration: Configuration,
    *,
    kind: Kind,
    duration: float,
    speed_scale: float,
    seed: int,
    floor: float | None = None,
    progress: Progress | None = None,
) -> tuple[InverseModel, MotionLimits, Trajectory]:
    """Find a motion that shows the robot's parameters, at rest where it begins and ends.

    - `kind`: ``designed`` (see `design_excitation`: for the condition number) or ``random`` (see
      `random_motion`: at once)
    - `duration`: s at full speed
    - `speed_scale`: share of the limits of speed and acceleration, above 0 to 1
    - `seed`: one seed gives one motion
    - `floor`: height that every moving frame stays above, m in the base frame

    Returns the nominal model, the scaled limits, and the motion.

    Raises UsageError or DataError: see `motion_limits`, `design_excitation`, `random_motion`.
    """
    if not 0.0 < speed_scale <= 1.0:
        raise UsageError(f"speed_scale {speed_scale:g}: a share above 0 and up to 1 is needed")
    if not 1.0 <= duration <= 1000.0:
        raise UsageError(f"duration {duration:g}: 1 to 1000 s are possible")
    model = load_model(configuration)
    whole = motion_limits(model, configuration, floor=floor)
    limits = replace(
        whole, velocity=speed_scale * whole.velocity, acceleration=speed_scale * whole.acceleration
    )
    if kind == "random":
        duration = round(duration * _RATE) / _RATE
        motion = random_motion(
            configuration, duration=duration, rate=_RATE, seed=seed, limits=limits
        )
        return model, limits, motion
    repeats = max(1, round(duration / _PERIOD))
    period = round(duration / repeats * _RATE) / _RATE
    settings = DesignSettings(
        period=period, repeats=repeats, rate=_RATE, seed=seed, time_limit=_LONGEST_SEARCH
    )
    return model, limits, design_excitation(model, limits, settings, progress).trajectory


def passes_of(
    model: InverseModel,
    limits: MotionLimits,
    motion: Trajectory,
    start: FloatArray,
    *,
    approach_speed: float,
    slow_speed: float,
) -> Passes:
    """Lead a robot that rests at `start` into a motion.

    - `model`, `limits`, `motion`: from `plan_passes`
    - `start`: (n_joints,) rad (m), in the order of the motion
    - `approach_speed`: share of the limits of speed on the way to the motion's start
    - `slow_speed`: speed of the slow pass, share of full speed

    Raises UsageError: the robot rests outside of its limits, or the way to the start leads below
    the floor.
    """
    for joint, place, lower, upper in zip(
        motion.joints, start, limits.lower, limits.upper, strict=True
    ):
        if not lower <= place <= upper:
            raise UsageError(
                f"joint {joint} is at {place:.4g}, outside of its limits {lower:.4g} to "
                f"{upper:.4g}: move it inside first"
            )
    # From rest to rest on the straight line in joint space.
    way = motion.position[0] - start
    speed, acceleration = approach_speed * limits.velocity, approach_speed * limits.acceleration
    samples = int(np.ceil(max(_SHORTEST, shortest_quintic(way, speed, acceleration)) * motion.rate))
    position, slope, curvature = way * quintic(np.linspace(0.0, 1.0, samples + 1)[:, None])
    seconds = samples / motion.rate
    approach = replace(
        motion,
        position=start + position,
        velocity=slope / seconds,
        acceleration=curvature / seconds**2,
    )
    if limits.floor is not None:
        use = limit_use(model.robot, limits, approach)
        if use.lowest_height < limits.floor:
            raise UsageError(
                f"the straight way to the start leads {use.lowest_frame} to "
                f"{use.lowest_height:.3g} m, below the floor: move the robot nearer to its start"
            )
    return Passes(limits, approach, slowed(motion, slow_speed), motion)


def slowed(motion: Trajectory, share: float) -> Trajectory:
    """Return the same path at a share of its speed, with as many samples."""
    return replace(
        motion,
        rate=motion.rate * share,
        velocity=motion.velocity * share,
        acceleration=motion.acceleration * share**2,
    )


def stop(
    joints: tuple[str, ...], position: FloatArray, velocity: FloatArray, limits: MotionLimits
) -> Trajectory:
    """Come to rest from a moving state, all joints at once, within the limits of acceleration.

    - `position`, `velocity`: (n_joints,) rad, rad/s (m, m/s) at the beginning
    - `limits`: in the order of the joints; where the range of a joint ends before the robot could
      come to rest, it is asked for the end of the range
    """
    whole = float(np.max(np.abs(velocity) / limits.acceleration))
    count = 20
    duration = max(whole, 0.05)
    time = np.linspace(0.0, duration, count + 1)[:, None]
    # Constant deceleration.
    share = 1.0 - time / duration
    places = position + velocity * (time - time**2 / (2.0 * duration))
    inside = (places > limits.lower) & (places < limits.upper)
    return Trajectory(
        joints,
        count / duration,
        np.clip(places, limits.lower, limits.upper),
        np.where(inside, velocity * share, 0.0),
        np.where(inside, np.broadcast_to(-velocity / duration, places.shape), 0.0),
    )
