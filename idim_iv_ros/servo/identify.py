"""From bags without efforts to the servos of a robot: `idim-iv servo` but for its files."""

from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import version

import numpy as np

from idim_iv_ros.compilation import one_thread
from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.files import FilePaths
from idim_iv_ros.identification.prepare import description_text, read_configured
from idim_iv_ros.model.inverse_model import configured_robot
from idim_iv_ros.model.robot import RobotModel
from idim_iv_ros.progress import Progress, Stopwatch
from idim_iv_ros.recording.recording import Recording
from idim_iv_ros.servo.fit import DriveEstimate, Run, fit_drive, fit_factor, residuals, scales
from idim_iv_ros.servo.numbers import absolute_numbers, interval_width, is_absolute, ratio_numbers
from idim_iv_ros.servo.result import GainCheck, ServoJoint, ServoResult, ServoSeries
from idim_iv_ros.servo.robot_fit import LARGEST_ANGLE, Motion, fit_servos, present_parameters
from idim_iv_ros.signals.joint_side import joint_transform

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

    Parameters
    ----------
    bags
        Recordings of one robot, used together.
    configuration
        With `signals.effort` ``none`` and the topic of the commands as `signals.reference`.
    gains
        The servos' setting in each recording, in any unit, where it differs; stiffness and ratios
        are those of the first.
    model_error
        Standard deviation of the nominal rigid-body torques, as a share of them.

    Raises
    ------
    UsageError
        The configuration is wrong, or has efforts or no reference.
    DataError
        The recordings cannot support the answer.
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
        fitted = fit_servos(motions, robot)
        watch.stage("held out", 0.7)
        joints = tuple(
            _joint(robot, number, runs, answer, model_error)
            for number, (runs, answer) in enumerate(fitted)
        )
        watch.stage("gains", 0.9)
        checks: tuple[GainCheck, ...] = ()
        if gains is not None and len(motions) > 1:
            checks = tuple(
                check
                for joint, (runs, answer) in zip(robot.joints, fitted, strict=True)
                for check in _gain_checks(joint, motions, runs, answer, settings)
            )
    return ServoResult(
        robot=robot.name,
        recordings=tuple(recording.path.name for recording in recordings),
        gain=settings[0],
        joints=joints,
        gains=checks,
        model_error=model_error,
        warnings=_warnings(configuration, robot, joints, motions, fitted),
        software={"idim_iv_ros": version("idim-iv-ros"), "scipy": version("scipy")},
        timing=watch.timing,
        series=_series(robot, motions, fitted),
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


def _joint(
    robot: RobotModel, number: int, runs: Sequence[Run], answer: DriveEstimate, model_error: float
) -> ServoJoint:
    """The result for a joint: numbers of its servo with intervals, and errors of position."""
    absolute = is_absolute(answer)
    reason = ""
    if not absolute:
        reason = (
            "the rigid bodies' torques hardly show in this motion, so that only ratios to the "
            "stiffness of the loop are known: add a known mass, or move where gravity acts"
        )
        start = answer.drive._replace(compliance=0.0, load_friction=0.0)
        free = [name for name in present_parameters(start) if name != "compliance"]
        answer = fit_drive(runs, start, free, scales(runs))
    position = np.concatenate([run.position[run.valid] for run in runs])
    steps = np.diff(np.unique(position))
    steps = steps[steps > 1e-7]
    asked = np.concatenate([(run.command - run.position)[run.used] for run in runs])
    return ServoJoint(
        joint=robot.joints[number],
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
    early = [np.arange(len(run.position))[:, None] < len(run.position) // 2 for run in runs]
    errors = []
    for halves in (early, [~half for half in early]):
        fitted, others = (
            [
                replace(run, valid=run.valid & (half == inside))
                for run, half in zip(runs, halves, strict=True)
            ]
            for inside in (True, False)
        )
        drive = fit_drive(fitted, answer.drive, answer.free, scales(runs)).drive
        errors.append(residuals(others, drive))
    error = np.concatenate(errors)
    return float(np.sqrt(np.mean(error**2))) if len(error) else float("nan")


def _gain_checks(
    joint: str,
    motions: Sequence[Motion],
    runs: Sequence[Run],
    answer: DriveEstimate,
    settings: Sequence[float],
) -> list[GainCheck]:
    """Compare the given gain of a recording with its estimate from all other recordings."""
    checks = []
    for number, (motion, given) in enumerate(zip(motions, settings, strict=True)):
        others = [run for k, run in enumerate(runs) if k != number]
        drive = fit_drive(others, answer.drive, answer.free, scales(runs))
        factor, std = fit_factor(runs[number], drive, "gain")
        wide = interval_width(drive) * std
        low, high = given * max(factor - wide, 0.0), given * (factor + wide)
        agrees = low <= given <= high or abs(factor - 1.0) < _SAME
        checks.append(
            GainCheck(
                recording=motion.name,
                joint=joint,
                given=given,
                estimated=given * factor,
                low=low,
                high=high,
                agrees=agrees,
            )
        )
    return checks


def _lost(
    joint: ServoJoint, motions: Sequence[Motion], runs: Sequence[Run], answer: DriveEstimate
) -> str:
    """Where a joint moves as no servo does: when it is off, blocked or pushed; else empty."""
    for motion, run in zip(motions, runs, strict=True):
        left = np.where(run.used, run.position - run.simulated(answer.drive), 0.0)[:, 0]
        window = max(int(_WINDOW * run.rate), 1)
        size = np.sqrt(np.convolve(left**2, np.ones(window) / window, mode="valid"))
        first = np.flatnonzero(size > _LOST * joint.nominal)
        if len(first):
            return (
                f"{motion.name}: {joint.joint} does not move as its servo asks from "
                f"{first[0] / run.rate:.1f} s on: is it off, blocked or pushed there? cut that part"
            )
    return ""


def _warnings(
    configuration: Configuration,
    robot: RobotModel,
    joints: Sequence[ServoJoint],
    motions: Sequence[Motion],
    fitted: Sequence[tuple[Sequence[Run], DriveEstimate]],
) -> tuple[str, ...]:
    warnings = list(robot.doubts)
    for joint, (runs, answer) in zip(joints, fitted, strict=True):
        warnings += filter(None, [_lost(joint, motions, runs, answer)])
    given = configuration.controller.kp
    for place, joint in enumerate(joints):
        stiffness = joint.number("stiffness")
        if given is not None and stiffness is not None:
            off = abs(given[place] / stiffness.value - 1.0) > _SAME
            if off and not stiffness.low <= given[place] <= stiffness.high:
                warnings.append(
                    f"{joint.joint}: controller.kp is {given[place]:.4g} N m/rad, and the "
                    f"recordings say {stiffness.low:.4g} to {stiffness.high:.4g}"
                )
    return tuple(warnings)


def _series(
    robot: RobotModel,
    motions: Sequence[Motion],
    fitted: Sequence[tuple[Sequence[Run], DriveEstimate]],
) -> tuple[ServoSeries, ...]:
    """Measured and simulated positions of the first recording, thinned for figures, by joint."""
    series = []
    for joint, (runs, answer) in zip(robot.joints, fitted, strict=True):
        run = runs[0]
        thin = slice(None, None, max(len(run.command) // _POINTS, 1))
        series.append(
            ServoSeries(
                joint=joint,
                recording=motions[0].name,
                time=(np.arange(len(run.command)) / run.rate)[thin],
                command=run.command[thin, 0],
                measured=run.position[thin, 0],
                simulated=run.simulated(answer.drive)[thin, 0],
            )
        )
    return tuple(series)
