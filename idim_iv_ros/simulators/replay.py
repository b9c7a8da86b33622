"""The recorded references once more, in MuJoCo: how far is the simulator from the robot?"""

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.refit.held_out import block_sums, interval, resampled, time_blocks
from idim_iv_ros.diagnosis.refit.law_speed import with_law_speed
from idim_iv_ros.effects.controller_mismatch import ControllerMismatch
from idim_iv_ros.effects.registry import BY_NAME
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.estimation.instruments import SimulatedLoop
from idim_iv_ros.estimation.sources import instrument_sources
from idim_iv_ros.files import EFFECTS, FilePath, FilePaths
from idim_iv_ros.identification.prepare import PreparedRegression, prepare, read_configured
from idim_iv_ros.model import RobotModel
from idim_iv_ros.model.mujoco_package import load_mujoco, mujoco_warnings
from idim_iv_ros.progress import Progress, Stopwatch
from idim_iv_ros.signals import Motion, central_differences
from idim_iv_ros.simulation import ControlLaw, SimulatedEffect
from idim_iv_ros.simulation.effects import joint_effects
from idim_iv_ros.simulators.effects_file import ExtendedModel, read_effects
from idim_iv_ros.simulators.mujoco_loop import MujocoMotion, References, run_in_mujoco
from idim_iv_ros.simulators.replay_models import (
    StageModel,
    nominal_stage,
    plant_stage,
    require_same_native,
    xml_stage,
)
from idim_iv_ros.simulators.replay_result import (
    CORRECTED,
    NOMINAL,
    WITH_EFFECTS,
    ReplayError,
    ReplayResult,
    ReplaySeries,
    ReplayStage,
)
from idim_iv_ros.types import FloatArray

URDF = "urdf"
# Share of a joint's torque beyond the gains of its law, from which on that is replayed, too.
_BEYOND_GAINS = 0.05


@dataclass(frozen=True)
class _Run:
    """One recording that is replayed: its law, and where in the session (s) it starts."""

    motion: Motion
    law: ControlLaw
    start: float


@dataclass(frozen=True)
class _Compared:
    """One stage on all recordings: filtered positions and torques on the whole record."""

    positions: tuple[FloatArray, ...]
    torques: tuple[FloatArray, ...]
    note: str


def replay_bags(
    bags: FilePaths,
    configuration: Configuration,
    *,
    model: FilePath = URDF,
    effects: FilePath | None = None,
    stages: Sequence[str] = (NOMINAL, CORRECTED, WITH_EFFECTS),
    progress: Progress | None = None,
) -> ReplayResult:
    """Run the recorded references in MuJoCo and compare with the recording.

    The control law is that of the configuration (fitted from the recordings where it is unknown):
    sampled and held, with its delay and limits; what it commands beyond its gains (a feedforward)
    is that of the recording. The robot starts where the recording does. Recordings that `effects`
    were found on are left out where there are others.

    Parameters
    ----------
    model
        ``urdf``: a MuJoCo model is made from the nominal model of the configuration, with the base
        parameters of `effects` where these are given. Else an MJCF file of the corrected robot.
    effects
        A diagnosis (gap.json) or a file of effects.
    stages
        Which are simulated, of those that there are; all of them by default.

    Raises
    ------
    UsageError
        MuJoCo is not installed, a file cannot be read or belongs to another robot, an effect is not
        known, or joints are coupled.
    DataError
        The recordings have no references, or the control law is not known.
    """
    mujoco = load_mujoco("a replay")
    with Stopwatch(progress) as watch:
        watch.stage("reading", 0.0)
        extended = None if effects is None else read_effects(Path(effects))
        prepared = prepare(read_configured(bags, configuration), configuration)
        known = _stages(mujoco, prepared, model, extended, effects)
        models = [stage for stage in known if stage.name in stages]
        fitted = () if extended is None else extended.recordings
        runs, notes = _runs(
            prepared, fitted, [effect for stage in known for effect in stage.effects]
        )
        compared = []
        for number, stage in enumerate(models):
            watch.stage(f"simulating: {stage.name}", 0.1 + 0.9 * number / len(models))
            compared.append(_compare(mujoco, prepared.model.robot, runs, stage))
    result = _result(prepared, [run.motion for run in runs], models, compared)
    return replace(
        result,
        model=URDF if str(model) == URDF else str(model),
        effects="" if effects is None else str(effects),
        held_out=None if not fitted else not any(bag in fitted for bag in result.bags),
        notes=result.notes + notes,
    )


def replayed_robot(bags: FilePaths, configuration: Configuration) -> RobotModel:
    """Return the robot that a configuration and its recordings describe."""
    return prepare(read_configured(bags, configuration), configuration).model.robot


def _runs(
    prepared: PreparedRegression, fitted: Collection[str], effects: Sequence[SimulatedEffect]
) -> tuple[list[_Run], tuple[str, ...]]:
    """Recordings that are replayed, without those of the fit where there are others; notes."""
    parts = prepared.session.parts
    runs = [
        _Run(motion, law, part.start)
        for motion, law, part in zip(prepared.motions, _laws(prepared), parts, strict=True)
    ]
    held_out = [run for run, part in zip(runs, parts, strict=True) if part.bag not in fitted]
    runs = held_out or runs
    if any(BY_NAME[effect.effect].part == "gains" for effect in effects):
        return runs, ()
    beyond = [_beyond_gains(run) for run in runs]
    sizes = [
        [_rms(part) for part in (torque, run.motion.filtered(run.motion.signals.torque))]
        for run, torque in zip(runs, beyond, strict=True)
    ]
    shares = np.max([rest / np.maximum(whole, 1e-300) for rest, whole in sizes], axis=0)
    worst = int(np.argmax(shares))
    if shares[worst] < _BEYOND_GAINS:
        return runs, ()
    joint = prepared.model.robot.joints[worst]
    note = (
        f"the law commands more than its gains ({100.0 * shares[worst]:.0f} % of the torque at "
        f"{joint}): this feedforward is that of the recording"
    )
    return [
        replace(run, law=replace(run.law, feedforward=np.nan_to_num(torque)))
        for run, torque in zip(runs, beyond, strict=True)
    ], (note,)


def _beyond_gains(run: _Run) -> FloatArray:
    """Torque (n_samples, n_joints) that the recorded command is more than its law, smoothed."""
    signals = run.motion.signals
    speed = np.gradient(signals.position, 1.0 / signals.rate, axis=0)
    law = [
        ControllerMismatch().parts(signals, run.law, joint, speed[:, joint]).command
        for joint in range(signals.position.shape[1])
    ]
    return run.motion.filtered(signals.torque - np.column_stack(law))


def _laws(prepared: PreparedRegression) -> tuple[ControlLaw, ...]:
    """Control law of each recording."""
    missing = [
        motion.signals.name
        for motion in prepared.motions
        if motion.signals.position_reference is None
    ]
    if missing:
        raise DataError(
            f"{', '.join(missing)}: no reference to replay; name its topic as signals.reference"
        )
    sources = with_law_speed(
        instrument_sources(
            prepared.configuration, prepared.model, prepared.motions, prepared.cutoffs
        )
    )
    source = sources.sources[0]
    if not isinstance(source, SimulatedLoop):
        raise DataError(" ".join(sources.controller) or "the control law is not known")
    return tuple(source.laws)


def _stages(
    mujoco: Any,
    prepared: PreparedRegression,
    model: FilePath,
    extended: ExtendedModel | None,
    source: FilePath | None,
) -> list[StageModel]:
    """Nominal, corrected and with effects, as far as there is something to simulate."""
    robot = prepared.model.robot
    if prepared.given is None:
        raise UsageError(prepared.why_no_given)
    stages = [nominal_stage(mujoco, prepared.model, prepared.configuration.robot.mjcf)]
    effects: tuple[SimulatedEffect, ...] = () if extended is None else extended.effects
    joint_effects(effects, robot.joints)  # refuses what is not known before anything is simulated
    parameters = {} if extended is None else extended.parameters
    if str(model) != URDF:
        offsets = {name: v for name, v in parameters.items() if re.fullmatch(r"off\d+", name)}
        stage = xml_stage(mujoco, robot, Path(model), offsets)
        if source is not None:
            require_same_native(mujoco, Path(model), effects, source)
        # Constant torques are parameters that the XML has no place for.
        planted = () if offsets else effects
        constant = [one for one in planted if BY_NAME[one.effect].part == "offset"]
        stages.append(
            replace(
                stage,
                effects=(*stage.effects, *constant),
                notes=_beside(Path(model), source),
            )
        )
    elif parameters:
        values = prepared.given.copy()
        names = list(prepared.model.base.names)
        for name, value in parameters.items():
            if name not in names:
                raise UsageError(
                    f"{source}: {name} is not a base parameter of this robot; they are "
                    f"{', '.join(names)}"
                )
            values[names.index(name)] = value
        stages.append(plant_stage(mujoco, prepared.model, values, CORRECTED))
    beyond = [effect for effect in effects if not BY_NAME[effect.effect].in_base_parameters]
    if beyond:
        stages.append(stages[-1].with_effects(WITH_EFFECTS, beyond))
    return stages


def _beside(model: Path, source: FilePath | None) -> tuple[str, ...]:
    """Say that effects of an export were left out, where they lie beside its MJCF."""
    effects = model.with_name(EFFECTS)
    if source is not None or not effects.is_file():
        return ()
    return (f"without the effects of {effects}: add --effects {effects}",)


def _compare(mujoco: Any, robot: RobotModel, runs: Sequence[_Run], stage: StageModel) -> _Compared:
    positions: list[FloatArray] = []
    torques: list[FloatArray] = []
    for run in runs:
        ran = _ran(mujoco, robot, run, stage)
        if ran.diverged:
            return _Compared((), (), f"{run.motion.signals.name}: {ran.diverged}")
        motion, first = run.motion, run.motion.span.start
        for made, before, after in (
            (positions, motion.position, ran.position),
            (torques, motion.signals.torque, ran.torque),
        ):
            made.append(motion.filtered(np.concatenate([before[:first], after])))
    return _Compared(tuple(positions), tuple(torques), "")


def _ran(mujoco: Any, robot: RobotModel, run: _Run, stage: StageModel) -> MujocoMotion:
    """Simulate from where the filtered motion is known, so that its speed there is, too."""
    motion, signals, first = run.motion, run.motion.signals, run.motion.span.start
    wanted = signals.position_reference
    assert wanted is not None
    speed = signals.velocity_reference
    if speed is None:
        speed = np.gradient(wanted, 1.0 / signals.rate, axis=0)
    start = motion.position[first]
    moving, _ = central_differences(motion.position, rate=signals.rate, start=first, stop=first + 1)
    when = run.start + first / signals.rate
    references = References(signals.rate, wanted[first:], speed[first:], start, moving[0], when)
    forward = run.law.feedforward
    law = replace(run.law, feedforward=None if forward is None else forward[first:])
    model = stage.compiled(mujoco)
    with mujoco_warnings():
        return run_in_mujoco(
            mujoco, model, robot.joints, law, references, robot.given, stage.effects
        )


def _result(
    prepared: PreparedRegression,
    motions: Sequence[Motion],
    models: Sequence[StageModel],
    compared: Sequence[_Compared],
) -> ReplayResult:
    robot = prepared.model.robot
    raw = [motion.signals.torque for motion in motions]
    smooth = [motion.filtered(torque) for motion, torque in zip(motions, raw, strict=True)]
    measured = [motion.position for motion in motions]
    noise = (
        _noise(motions, [motion.signals.position for motion in motions], measured),
        _noise(motions, raw, smooth),
    )
    stages = []
    for stage, found in zip(models, compared, strict=True):
        errors: dict[str, dict[str, ReplayError] | None] = {"tracking": None, "torque": None}
        if not found.note:
            for kind, simulated, recorded, level in (
                ("tracking", found.positions, measured, noise[0]),
                ("torque", found.torques, smooth, noise[1]),
            ):
                errors[kind] = _errors(robot.joints, motions, simulated, recorded, level)
        tool = None if found.note else _tool(robot, motions, found.positions, measured)
        stages.append(
            ReplayStage(
                stage.name, stage.words, errors["tracking"], errors["torque"], tool, found.note
            )
        )
    seconds = sum((m.span.stop - m.span.start) / m.signals.rate for m in motions)
    positions = {"recorded": measured[0]}
    positions |= {
        stage.name: found.positions[0]
        for stage, found in zip(models, compared, strict=True)
        if not found.note
    }
    return ReplayResult(
        robot=robot.name,
        joints=robot.joints,
        joint_types=robot.joint_types,
        bags=tuple(motion.signals.name for motion in motions),
        duration=seconds,
        software=_software(),
        model=URDF,
        tracking_noise=dict(zip(robot.joints, map(float, noise[0]), strict=True)),
        torque_noise=dict(zip(robot.joints, map(float, noise[1]), strict=True)),
        stages=tuple(stages),
        notes=prepared.doubts + tuple(note for stage in models for note in stage.notes),
        series=_series(robot.joints, motions, smooth, models, compared),
        positions=positions,
        rate=motions[0].signals.rate,
    )


def _tool(
    robot: RobotModel,
    motions: Sequence[Motion],
    simulated: Sequence[FloatArray],
    recorded: Sequence[FloatArray],
) -> ReplayError:
    """Distance of the centres of the last link."""
    tree = robot.pinocchio
    data, last = tree.createData(), tree.njoints - 1
    centre = np.array(tree.inertias[last].lever)

    def places(positions: FloatArray) -> FloatArray:
        found = np.empty((len(positions), 3))
        for row, position in enumerate(positions):
            pin.forwardKinematics(tree, data, position)
            found[row] = data.oMi[last].act(centre)
        return found

    apart = [
        np.linalg.norm(places(one) - places(other), axis=1, keepdims=True)
        for one, other in zip(simulated, recorded, strict=True)
    ]
    none = [np.zeros_like(rows) for rows in apart]
    return _errors(("tool",), motions, apart, none, np.zeros(1))["tool"]


def _rms(values: FloatArray) -> FloatArray:
    """(n,) of columns, where they are known."""
    return np.asarray(np.sqrt(np.nanmean(values**2, axis=0)))


def _noise(
    motions: Sequence[Motion], raw: Sequence[FloatArray], smooth: Sequence[FloatArray]
) -> FloatArray:
    """Standard deviation of what the filter takes away, (n_joints,)."""
    parts = [
        (one - other)[motion.span] for motion, one, other in zip(motions, raw, smooth, strict=True)
    ]
    return np.asarray(np.nanstd(np.concatenate(parts), axis=0))


def _errors(
    joints: Sequence[str],
    motions: Sequence[Motion],
    simulated: Sequence[FloatArray],
    recorded: Sequence[FloatArray],
    noise: FloatArray,
) -> dict[str, ReplayError]:
    """Root mean squares, their interval by blocks of time, and their ratio to the noise."""
    squares, lengths = [], []
    for motion, one, other in zip(motions, simulated, recorded, strict=True):
        error = (one - other)[motion.span]
        (blocks,) = time_blocks([len(error)], motion.signals.rate)
        known = np.nan_to_num(error**2)
        squares.append(np.column_stack([block_sums(blocks, column) for column in known.T]))
        lengths.append(block_sums(blocks, np.ones(len(error))))
    table = np.column_stack([np.concatenate(squares), np.concatenate(lengths)])
    total = table.sum(axis=0)
    draws = resampled(table)
    found = {}
    for joint, name in enumerate(joints):
        rms = float(np.sqrt(total[joint] / total[-1]))
        low, high = interval(np.sqrt(draws[:, joint] / draws[:, -1]))
        level = float(noise[joint])
        found[name] = ReplayError(rms, low, high, rms / level if level > 0.0 else np.nan)
    return found


def _series(
    joints: Sequence[str],
    motions: Sequence[Motion],
    smooth: Sequence[FloatArray],
    models: Sequence[StageModel],
    compared: Sequence[_Compared],
) -> tuple[ReplaySeries, ...]:
    """The first recording, thinned."""
    motion = motions[0]
    reference = motion.signals.position_reference
    assert reference is not None
    span = motion.span
    thin = slice(span.start, span.stop, max(1, (span.stop - span.start) // settings.MOST_POINTS))
    time = np.arange(len(reference))[thin] / motion.signals.rate
    done = [(m.name, c) for m, c in zip(models, compared, strict=True) if not c.note]
    return tuple(
        ReplaySeries(
            joint=name,
            bag=motion.signals.name,
            time=time,
            error=(reference - motion.position)[thin, j],
            errors={stage: (reference - c.positions[0])[thin, j] for stage, c in done},
            torque=smooth[0][thin, j],
            torques={stage: c.torques[0][thin, j] for stage, c in done},
        )
        for j, name in enumerate(joints)
    )


def _software() -> dict[str, str]:
    from importlib.metadata import version

    return {"idim_iv_ros": version("idim-iv-ros"), "mujoco": version("mujoco")}
