"""From bags without efforts to the servos of a robot: `idim-iv servo` but for its files."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from importlib.metadata import version

import numpy as np
import scipy

from idim_iv_ros.compilation import one_thread
from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.files import FilePaths
from idim_iv_ros.identification.prepare import description_text, read_configured
from idim_iv_ros.model.inverse_model import configured_robot
from idim_iv_ros.model.robot import RobotModel
from idim_iv_ros.progress import Progress, Stopwatch
from idim_iv_ros.recording.recording import Recording
from idim_iv_ros.servo import fit
from idim_iv_ros.servo.fit import LARGEST_ANGLE, PARAMETERS, DriveEstimate, Motion, Run
from idim_iv_ros.servo.result import GainCheck, ServoJoint, ServoNumber, ServoResult, ServoSeries
from idim_iv_ros.signals.joint_side import joint_transform
from idim_iv_ros.types import FloatArray

_LEVEL = 0.95
_SHOWN = 1.0 / 3.0  # Largest ratio of a standard deviation to 1 / K at which it may be divided by
# Names and units of what a parameter is times the stiffness (none: of no use), and of itself.
_NAMES = {
    "inertia": ("armature", "kg m²", "armature / stiffness", "s²"),
    "damping": ("damping", "N m s/rad", "damping / stiffness", "s"),
    "friction": ("dry friction", "N m", "dry friction / stiffness", "rad"),
    "offset": ("offset", "N m", "offset / stiffness", "rad"),
    "delay": ("", "", "delay", "s"),
    "limit": ("torque limit", "N m", "error at the torque limit", "rad"),
}
WITH_LINKS = "inertia of drive and links / stiffness"


def interval_width(answer: DriveEstimate) -> float:
    """Half of a 95 % interval, in standard deviations that blocks of time gave (Student's t)."""
    return float(scipy.stats.t.ppf(0.5 + 0.5 * _LEVEL, max(answer.blocks - 1, 1)))


def is_absolute(answer: DriveEstimate) -> bool:
    """Whether the recording shows the stiffness in N m/rad."""
    std = float(np.sqrt(answer.covariance[0, 0]))
    return answer.drive.compliance > 0.0 and std <= _SHOWN * answer.drive.compliance


def absolute_numbers(answer: DriveEstimate, model_error: float) -> tuple[ServoNumber, ...]:
    """Stiffness, armature, damping, dry friction, offset, torque limit and friction by load.

    - `model_error`: standard deviation of the nominal torques, as a share of them
    """
    width, compliance = interval_width(answer), answer.drive.compliance
    covariance = answer.covariance.copy()
    covariance[0, 0] += (model_error * compliance) ** 2
    half = width * float(np.sqrt(covariance[0, 0]))
    low = 1.0 / (compliance + half)
    high = 1.0 / (compliance - half) if half < compliance else np.inf
    numbers = [
        ServoNumber(
            name="stiffness", unit="N m/rad", value=1.0 / compliance, low=low, high=high, shown=True
        )
    ]
    for kind, (name, unit, _, _) in _NAMES.items():
        value = getattr(answer.drive, kind)
        slopes = {"compliance": -value / compliance**2, kind: 1.0 / compliance}
        if name:
            numbers.append(_number(name, unit, value / compliance, slopes, covariance, width))
    by_load = answer.drive.load_friction
    slopes = {"load_friction": 1.0}
    return (*numbers, _number("friction by load", "1", by_load, slopes, covariance, width))


def ratio_numbers(answer: DriveEstimate, *, with_links: bool) -> tuple[ServoNumber, ...]:
    """Numbers of a servo that need no torque: ratios to its stiffness.

    - `with_links`: whether the inertia is that of the links, too, because they were not told apart
    """
    width, covariance, numbers = interval_width(answer), answer.covariance, []
    for kind, (_, _, name, unit) in _NAMES.items():
        name = WITH_LINKS if kind == "inertia" and with_links else name
        value = getattr(answer.drive, kind)
        numbers.append(_number(name, unit, value, {kind: 1.0}, covariance, width))
    limit, damping = answer.drive.limit, answer.drive.damping
    if np.isfinite(limit) and damping > 0.0:
        slopes = {"limit": 1.0 / damping, "damping": -limit / damping**2}
        speed = limit / damping
        numbers.append(_number("speed at no load", "rad/s", speed, slopes, covariance, width))
    return tuple(numbers)


def _number(
    name: str,
    unit: str,
    value: float,
    slopes: dict[str, float],
    covariance: FloatArray,
    width: float,
) -> ServoNumber:
    """A number with its interval, from its derivatives by the parameters."""
    if not np.isfinite(value):
        return ServoNumber(name=name, unit=unit, value=np.nan, low=np.nan, high=np.inf, shown=False)
    slope = np.array([slopes.get(parameter, 0.0) for parameter in PARAMETERS])
    half = width * float(np.sqrt(slope @ covariance @ slope))
    low, high, either_sign = value - half, value + half, "offset" in slopes
    return ServoNumber(
        name=name,
        unit=unit,
        value=float(value),
        low=float(low if either_sign else max(low, 0.0)),
        high=float(high),
        shown=low > 0.0 or (either_sign and high < 0.0),
    )


_SAME = 0.1  # share by which a gain may differ from the one given and be called the same
_WINDOW, _LOST = 1.0, 0.5  # s; share of the tracking error at which no servo explains a motion
_LAGS = 25  # samples by which a command may be a copy of the position
_POINTS = 600  # of a picture


def identify_servos(
    bags: FilePaths,
    configuration: Configuration,
    *,
    gains: Sequence[float] | None = None,
    model_error: float = 0.05,
    progress: Progress | None = None,
) -> ServoResult:
    """Identify the servos of a robot from commands and positions.

    - `bags`: recordings of one robot, used together
    - `configuration`: with `signals.effort` ``none`` and the topic of the commands as
      `signals.reference`
    - `gains`: the servos' setting in each recording, in any unit, where it differs; stiffness and
      ratios are those of the first
    - `model_error`: standard deviation of the nominal rigid-body torques, as a share of them

    Raises UsageError: the configuration is wrong, or has efforts or no reference; DataError: the
    recordings cannot support the answer.
    """
    source = configuration.source or "the configuration"
    if configuration.signals.effort_topic is not None:
        raise UsageError(
            f"{source}: the robot has efforts: use `idim-iv identify`; servos are for "
            "`effort: none` under `signals:`"
        )
    if configuration.signals.reference is None:
        raise UsageError(f"{source}: signals.reference is missing: the topic of the commands")
    with one_thread(), Stopwatch(progress) as watch:
        watch.stage("reading", 0.0)
        recordings = read_configured(bags, configuration, progress)
        if gains is not None and len(gains) != len(recordings):
            raise UsageError(f"--gains: {len(gains)} values for {len(recordings)} recordings")
        urdf, name = description_text(configuration, recordings)
        robot = configured_robot(configuration, urdf, name)
        settings = [1.0] * len(recordings) if gains is None else list(gains)
        motions = [
            _motion(recording, configuration, robot, setting / settings[0])
            for recording, setting in zip(recordings, settings, strict=True)
        ]
        watch.stage("fit", 0.3)
        fitted = fit.fit_servos(motions, robot)
        watch.stage("held out", 0.7)
        joints = tuple(
            _joint(name, runs, answer, model_error)
            for name, (runs, answer) in zip(robot.joints, fitted, strict=True)
        )
        watch.stage("gains", 0.9)
        checks: list[GainCheck] = []
        if gains is not None and len(motions) > 1:
            for joint, (runs, answer) in zip(robot.joints, fitted, strict=True):
                checks += _gain_checks(joint, runs, answer, settings)
    return ServoResult(
        robot=robot.name,
        recordings=tuple(recording.path.name for recording in recordings),
        gain=settings[0],
        joints=joints,
        gains=tuple(checks),
        model_error=model_error,
        warnings=tuple(_warnings(configuration, robot, joints, fitted)),
        software={"idim_iv_ros": version("idim-iv-ros"), "scipy": version("scipy")},
        timing=watch.timing,
        series=tuple(
            _series(joint, runs[0], answer)
            for joint, (runs, answer) in zip(robot.joints, fitted, strict=True)
        ),
    )


def _motion(
    recording: Recording, configuration: Configuration, robot: RobotModel, gain: float
) -> Motion:
    """Commands and positions of the joints, as they were recorded."""
    asked = recording.position_reference
    assert asked is not None
    transform = joint_transform(configuration)
    nothing = np.zeros_like(asked.invented)
    invented = transform.touched(recording.position.invented, nothing)
    motion = Motion(
        rate=recording.rate,
        command=transform.position(asked.values),
        position=transform.position(recording.position.values),
        valid=~(invented | transform.touched(asked.invented, nothing)),
        gain=gain,
        name=recording.path.name,
    )
    for column, joint in enumerate(robot.joints):
        if robot.joint_types[column] != "revolute":
            raise UsageError(f"{joint} is prismatic: servos are identified at turning joints")
        _require_servo(f"{motion.name}: {joint}", motion, column)
    return motion


def _require_servo(where: str, motion: Motion, column: int) -> None:
    """Refuse what no servo records.

    Raises DataError: degrees, a command that is a copy of the position, or one that never moves.
    """
    command, position = motion.command[:, column], motion.position[:, column]
    if max(np.abs(command).max(), np.abs(position).max()) > LARGEST_ANGLE:
        raise DataError(
            f"{where} is at {np.abs(position).max():.3g} rad: these look like degrees; import them "
            "with `position: deg` under `units:` of the map"
        )
    span = float(np.ptp(command))
    if span == 0.0:
        raise DataError(f"{where} is asked for one position throughout: record a motion of it")
    least = 1e-3 * span
    for lag in range(1, _LAGS):
        if np.sqrt(np.mean((command[lag:] - position[:-lag]) ** 2)) < least:
            raise DataError(
                f"{where}: the command is the measured position, {lag} samples later: name the "
                "topic of what the servo was asked for as signals.reference"
            )


def _joint(name: str, runs: Sequence[Run], answer: DriveEstimate, model_error: float) -> ServoJoint:
    absolute = is_absolute(answer)
    reason = ""
    if not absolute:
        reason = (
            "the rigid bodies' torques hardly show in this motion, so that only ratios to the "
            "stiffness of the loop are known: add a known mass, or move where gravity acts"
        )
        start = answer.drive._replace(compliance=0.0, load_friction=0.0)
        free = [kind for kind in fit.present_parameters(start) if kind != "compliance"]
        answer = fit.fit_drive(runs, start, free)
    steps = np.diff(np.unique(np.concatenate([run.position[run.valid] for run in runs])))
    steps = steps[steps > 1e-7]
    asked = np.concatenate([(run.command - run.position)[run.used] for run in runs])
    return ServoJoint(
        joint=name,
        absolute=absolute,
        reason=reason,
        numbers=absolute_numbers(answer, model_error) if absolute else (),
        ratios=ratio_numbers(answer, with_links=not absolute),
        residual=answer.residual,
        held_out=_held_out(runs, answer),
        nominal=float(np.sqrt(np.mean(asked**2))),
        resolution=float(steps.min()) if len(steps) else None,
    )


def _held_out(runs: Sequence[Run], answer: DriveEstimate) -> float:
    """Rms error of position, rad, at half the recordings after a fit to the other half."""
    parts = []
    for run in runs:
        early = np.arange(len(run.position))[:, None] < len(run.position) // 2
        parts.append([replace(run, valid=run.valid & half) for half in (early, ~early)])
    first, second = zip(*parts, strict=True)
    errors = [
        fit.residuals(others, fit.fit_drive(fitted, answer.drive, answer.free).drive)
        for fitted, others in ((first, second), (second, first))
    ]
    error = np.concatenate(errors)
    return float(np.sqrt(np.mean(error**2))) if len(error) else float("nan")


def _gain_checks(
    joint: str, runs: Sequence[Run], answer: DriveEstimate, settings: Sequence[float]
) -> Iterator[GainCheck]:
    """Compare the given gain of a recording with its estimate from all other recordings."""
    for tested, given in zip(runs, settings, strict=True):
        drive = fit.fit_drive([run for run in runs if run is not tested], answer.drive, answer.free)

        def scaled(factor: float, run: Run = tested) -> Run:
            return replace(run, gain=factor * run.gain)

        factor, std = fit.fit_factor(scaled, drive)
        wide = interval_width(drive) * std
        low, high = given * max(factor - wide, 0.0), given * (factor + wide)
        yield GainCheck(
            recording=tested.name,
            joint=joint,
            given=given,
            estimated=given * factor,
            low=low,
            high=high,
            agrees=low <= given <= high or abs(factor - 1.0) < _SAME,
        )


def _warnings(
    configuration: Configuration,
    robot: RobotModel,
    joints: Sequence[ServoJoint],
    fitted: Sequence[tuple[Sequence[Run], DriveEstimate]],
) -> Iterator[str]:
    yield from robot.doubts
    for joint, (runs, answer) in zip(joints, fitted, strict=True):
        for run in runs:
            left = np.where(run.used, run.position - run.simulated(answer.drive), 0.0)[:, 0]
            window = max(int(_WINDOW * run.rate), 1)
            size = np.sqrt(np.convolve(left**2, np.ones(window) / window, mode="valid"))
            lost = np.flatnonzero(size > _LOST * joint.nominal)
            if len(lost):
                yield (
                    f"{run.name}: {joint.joint} does not move as its servo asks from "
                    f"{lost[0] / run.rate:.1f} s on: is it off, blocked or pushed there? cut that "
                    "part"
                )
                break
    given = configuration.controller.kp
    for place, joint in enumerate(joints):
        stiffness = joint.number("stiffness")
        if given is not None and stiffness is not None:
            off = abs(given[place] / stiffness.value - 1.0) > _SAME
            if off and not stiffness.low <= given[place] <= stiffness.high:
                yield (
                    f"{joint.joint}: controller.kp is {given[place]:.4g} N m/rad, and the "
                    f"recordings say {stiffness.low:.4g} to {stiffness.high:.4g}"
                )


def _series(joint: str, run: Run, answer: DriveEstimate) -> ServoSeries:
    thin = slice(None, None, max(len(run.command) // _POINTS, 1))
    return ServoSeries(
        joint=joint,
        recording=run.name,
        time=(np.arange(len(run.command)) / run.rate)[thin],
        command=run.command[thin, 0],
        measured=run.position[thin, 0],
        simulated=run.simulated(answer.drive)[thin, 0],
    )
