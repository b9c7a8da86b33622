"""From a configuration to a motion, designed or random, and the way of a robot through it.

The way: slowly to its start, a slow pass, then at full speed. Files of a motion appear all or none:
``.csv``, the trajectory; ``.yaml``, a trajectory_msgs/msg/JointTrajectory for ``ros2 topic pub``;
``.json``, its figures.
"""

import io
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, TextIO

import numpy as np

from idim_iv_ros import files
from idim_iv_ros.configuration import Configuration
from idim_iv_ros.encoding import json_text
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.excitation.design import (
    Design,
    DesignSettings,
    PredictedParameter,
    design_excitation,
    predict_parameters,
)
from idim_iv_ros.excitation.diagnosis import NOT_REVEALED, Diagnosis
from idim_iv_ros.excitation.limits import LimitUse, MotionLimits, limit_use, motion_limits
from idim_iv_ros.excitation.trajectory import (
    FourierBasis,
    Trajectory,
    quintic,
    require_sampling,
    shortest_quintic,
    write_csv,
)
from idim_iv_ros.files import FilePath
from idim_iv_ros.model import InverseModel, build_inverse_model, read_urdf_file
from idim_iv_ros.progress import Progress
from idim_iv_ros.types import FloatArray

FORMAT = "idim_iv_ros/excitation/1"
_OF_SEGMENTS = ("name", "kind", "start", "end", "effects", "speed", "amplitude", "frequency")


def require_place(out: FilePath, *, force: bool = False) -> None:
    """Make sure, before long work, that the files of a motion can be written afterwards.

    `out` is their stem, or one of them; `force` replaces files that this program did not write.

    Raises UsageError: `out` is a folder or has no name, or as `require_file_place`.
    """
    if Path(out).is_dir():
        raise UsageError(f"{out} is a folder; give another --out")
    files.require_file_place(_files(out), force=force)


def write_motion(
    out: FilePath,
    trajectory: Trajectory,
    document: Mapping[str, object],
    *,
    message_rate: float,
    force: bool = False,
) -> tuple[Path, ...]:
    """Write ``STEM.csv``, ``STEM.yaml`` and ``STEM.json``; return their paths in this order.

    `out` and `force` as in `require_place`; `document`: figures, for JSON; `message_rate`: points
    per second of the JointTrajectory.

    Raises UsageError: a file cannot be written, or must not be replaced; none is then left behind.
    """
    table, message = io.StringIO(), io.StringIO()
    write_csv(trajectory, table)
    write_joint_trajectory(trajectory, message, rate=message_rate)
    table_file, message_file, figures = paths = _files(out)
    texts = {table_file: table.getvalue(), message_file: message.getvalue()}
    signed = files.digests({path.name: text for path, text in texts.items()})
    files.require_replaceable(paths, force=force)
    with files.refused_if_unwritable(out):
        files.write_together({**texts, figures: json_text({**document, files.FILES: signed})})
    return paths


def write_joint_trajectory(trajectory: Trajectory, file: TextIO, *, rate: float) -> None:
    """Write the message; its points are every k-th sample and the last one.

    ``ros2 topic pub --once --yaml-file FILE TOPIC trajectory_msgs/msg/JointTrajectory`` and
    ``"$(cat FILE)"`` accept the text. A joint_trajectory_controller interpolates between the
    points (quintic splines where points have accelerations, as here).

    - `rate`: points per second; the nearest that divides the trajectory's rate is used

    Raises UsageError: `rate` is not between 0 and the rate of the trajectory.
    """
    if not 0.0 < rate <= trajectory.rate:
        raise UsageError(
            f"{rate:g} points per second: a rate above 0 and up to that of the trajectory, "
            f"{trajectory.rate:g} per second, is needed"
        )
    file.write("header: {stamp: {sec: 0, nanosec: 0}, frame_id: ''}\n")
    file.write(f"joint_names: {json.dumps(trajectory.joints, ensure_ascii=False)}\n")
    file.write("points:\n")
    for nanoseconds, point in trajectory.points(rate):
        position, velocity, acceleration = map(_numbers, point)
        file.write(
            f"- {{positions: {position},\n   velocities: {velocity},\n"
            f"   accelerations: {acceleration},\n"
            f"   effort: [], time_from_start: {{sec: {nanoseconds // 10**9}, "
            f"nanosec: {nanoseconds % 10**9}}}}}\n"
        )


def motion_document(
    purpose: str,
    robot: str,
    trajectory: Trajectory,
    limits: MotionLimits,
    use: LimitUse,
    settings: Mapping[str, object],
    **figures: object,
) -> dict[str, object]:
    """Figures of a motion for JSON: what was asked for, limits and what is used of them.

    Limits in rad, rad/s, rad/s², N m and m; `figures`: what motions of this purpose have beyond.
    """
    allowed, used = ({k: _plain(v) for k, v in vars(part).items()} for part in (limits, use))
    return {
        "format": FORMAT,
        "purpose": purpose,
        "robot": robot,
        "joints": list(trajectory.joints),
        "settings": dict(settings),
        "duration": trajectory.duration,
        **figures,
        "limits": allowed,
        "use": used,
    }


def diagnosis_document(
    robot: str, limits: MotionLimits, diagnosis: Diagnosis, seed: int
) -> dict[str, object]:
    """Figures of a motion for diagnosis: segments and effects among them."""
    return motion_document(
        "diagnosis",
        robot,
        diagnosis.trajectory,
        limits,
        diagnosis.use,
        {"rate": diagnosis.trajectory.rate, "seed": seed},
        loop_bandwidth=diagnosis.bandwidth.tolist(),
        loop_bandwidth_known=diagnosis.bandwidth_configured,
        # s, rad/s (m/s), rad (m), Hz
        segments=[
            {name: _plain(getattr(segment, name)) for name in _OF_SEGMENTS}
            for segment in diagnosis.segments
        ],
        not_revealed=[
            {"effect": effect, "excitation_needed": needed}
            for effect, needed in NOT_REVEALED.items()
        ],
    )


def _plain(value: object) -> object:
    return value.tolist() if isinstance(value, np.ndarray) else value


def _files(out: FilePath) -> tuple[Path, ...]:
    """CSV, YAML and JSON, of ``run.csv`` and of ``run`` the same."""
    out, endings = files.as_file(out), (".csv", ".yaml", ".json")
    stem = out.stem if out.suffix in endings else out.name
    return tuple(out.with_name(f"{stem}{ending}") for ending in endings)


def _numbers(values: Iterable[float]) -> str:
    # A decimal point in every number: YAML would read 0 as an integer and 1e-05 as text.
    return "[" + ", ".join(f"{value + 0.0:.7f}" for value in values) + "]"


_LEAST_NOISE = 1e-6  # of the torque limit: no effort is measured more finely

_HIGHEST_FREQUENCY = 2.0  # Hz
_SERVO_SECONDS = 20.0
_LONGEST = 1000.0  # s; the work grows with the square of the duration
_SHRINK = 0.8
_ATTEMPTS = 20


@dataclass(frozen=True)
class Excitation:
    """A motion for identification with its figures."""

    design: Design
    parameters: tuple[PredictedParameter, ...]  # The worst first
    torque_noise: float  # Share of each torque limit that `parameters` assumes
    document: Mapping[str, object] = field(repr=False)  # All figures, as they are written to JSON


def load_model(configuration: Configuration) -> InverseModel:
    """Build the nominal model, with torques in N m whatever the recordings hold.

    Raises UsageError: the configuration names no URDF, or one that cannot be used.
    """
    urdf = configuration.robot.description
    if urdf is None:
        source = configuration.source
        raise UsageError(f"{source}: robot.urdf or robot.mjcf is needed to design a motion")
    text = read_urdf_file(urdf)
    return build_inverse_model(configuration.changed("signals", effort_unit="N m"), text, str(urdf))


def excite(
    model: InverseModel,
    limits: MotionLimits,
    settings: DesignSettings,
    *,
    torque_noise: float = 0.005,
    progress: Progress | None = None,
) -> Excitation:
    """Design a motion for identification and predict what it shows.

    `torque_noise`: standard deviation of the torque noise at a sample, share of the torque limit.

    Raises UsageError or DataError: see `motion_limits`, `design_excitation`, `predict_parameters`.
    """
    if not _LEAST_NOISE <= torque_noise < 1.0:
        raise UsageError(
            f"torque noise {torque_noise:g}: a share from {_LEAST_NOISE:g} to below 1 is needed"
        )
    design = design_excitation(model, limits, settings, progress)
    parameters = predict_parameters(
        model, design.period, settings.repeats, limits.torque, torque_noise
    )
    document = motion_document(
        "identification",
        model.robot.name,
        design.trajectory,
        limits,
        design.use,
        {
            **vars(settings),
            "start": None if settings.start is None else list(map(float, settings.start)),
            "torque_noise": torque_noise,
        },
        ended_early=design.ended_early,
        seconds=round(design.seconds, 2),
        condition_number={"random_median": vars(design.before), "designed": vars(design.after)},
        parameters=[
            {**vars(parameter), "relative_std": parameter.relative_std, "bad": parameter.bad}
            for parameter in parameters
        ],
    )
    return Excitation(design, parameters, torque_noise, document)


def random_motion(
    configuration: Configuration,
    *,
    duration: float,
    rate: float,
    seed: int,
    limits: MotionLimits | None = None,
) -> Trajectory:
    """One period of a random Fourier series up to 2 Hz, at rest at both ends, within every limit.

    Fast, unlike a motion designed for its condition number, which is the same at any speed; but
    nothing is optimised. `design_excitation` does that.

    `duration` in s, `rate` in samples per second; `limits`: what it may use, else `motion_limits`.

    Raises UsageError: no URDF, a limit that is missing, a duration that is not 1 to 1000 s, or as
    `require_sampling`. DataError: the robot cannot even stay near the middle of its range.
    """
    if not 1.0 <= duration <= _LONGEST:
        raise UsageError(
            f"duration {duration:g}: a random motion lasts 1 to {_LONGEST:g} s; design a longer "
            "one with idim-iv excite --for diagnosis"
        )
    require_sampling(rate, duration, "the random motion")
    model = load_model(configuration)
    limits = limits or motion_limits(model, configuration)
    random = np.random.default_rng(seed)
    joints = len(limits.lower)
    basis = FourierBasis(duration, round(_HIGHEST_FREQUENCY * duration))
    coefficients = random.normal(size=(basis.size, joints))
    posture = limits.middle + limits.half_range * random.uniform(-0.2, 0.2, joints)
    wave, slope, curve = basis.motion(np.arange(round(duration * rate) + 1) / rate, coefficients)
    room = limits.room(posture)
    scale = np.minimum(room / np.abs(wave).max(axis=0), limits.velocity / np.abs(slope).max(axis=0))
    scale = np.minimum(scale, limits.acceleration / np.abs(curve).max(axis=0)) * limits.margin
    for _ in range(_ATTEMPTS):
        motion = Trajectory(
            tuple(model.robot.joints), rate, posture + scale * wave, scale * slope, scale * curve
        )
        if limit_use(model.robot, limits, motion).within(limits):
            return motion
        scale = _SHRINK * scale
    raise DataError(
        "no random motion keeps the torque limits: design one with idim-iv excite, or look at "
        "the effort limits of the URDF"
    )


def servo_motion(
    configuration: Configuration, limits: MotionLimits, *, rate: float, seed: int
) -> tuple[Trajectory, float, dict[str, object]]:
    """Return 20 s that show servos: a random motion as fast as its limits let it be.

    Reversals show dry friction and dead zone, accelerations armature and delay, and postures away
    from the middle the load that makes torques absolute.

    Returns the trajectory, its highest frequency in Hz, and its figures.
    """
    settings = {"rate": rate, "seed": seed}
    trajectory = random_motion(
        configuration, duration=_SERVO_SECONDS, rate=rate, seed=seed, limits=limits
    )
    robot = load_model(configuration).robot
    use = limit_use(robot, limits, trajectory)
    document = motion_document("servo", robot.name, trajectory, limits, use, settings)
    return trajectory, _HIGHEST_FREQUENCY, document


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
    """Come to rest from position and velocity (n_joints,), rad, rad/s (m, m/s), joints at once.

    Accelerations keep their limits; where the range of a joint ends before the robot could come to
    rest, it is asked for the end of the range.
    """
    count, duration = 20, max(float(np.max(np.abs(velocity) / limits.acceleration)), 0.05)
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
