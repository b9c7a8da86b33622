"""Replay of recorded references in MuJoCo: how far is the simulator from the robot?"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.refit.command_rows import with_law_speed
from idim_iv_ros.diagnosis.refit.held_out import time_blocks
from idim_iv_ros.effects.registry import BY_NAME, CONTROL_LAW
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
from idim_iv_ros.simulators.effects_file import EffectsFile, read_effects
from idim_iv_ros.simulators.mujoco_loop import References, run_in_mujoco
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
from idim_iv_ros.statistics.bootstrap import energies, interval, resampled, roots
from idim_iv_ros.types import FloatArray

URDF = "urdf"
# Share of a joint's torque beyond the gains of its law, from which on that is replayed, too.
_BEYOND_GAINS = 0.05


@dataclass(frozen=True)
class _Run:
    """One recording to replay: control law, and its start in the session, s."""

    motion: Motion
    law: ControlLaw
    start: float


@dataclass(frozen=True)
class _Simulated:
    """One stage on all recordings: filtered positions and torques, or why it failed."""

    positions: Sequence[FloatArray] = ()
    torques: Sequence[FloatArray] = ()
    note: str = ""


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
        Names of the stages to simulate; all available ones by default.

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
        extended = EffectsFile() if effects is None else read_effects(Path(effects))
        prepared = prepare(read_configured(bags, configuration), configuration)
        possible = _stages(mujoco, prepared, model, extended, effects)
        models = [stage for stage in possible if stage.name in stages]
        fitted = extended.recordings
        planted = [effect for stage in possible for effect in stage.effects]
        runs, notes = _runs(prepared, fitted, planted)
        robot = prepared.model.robot
        simulated = []
        for number, stage in enumerate(models):
            watch.stage(f"simulating: {stage.name}", 0.1 + 0.9 * number / len(models))
            simulated.append((stage, _simulate(mujoco, robot, runs, stage)))
    motions = [run.motion for run in runs]
    comparison = _Comparison(robot, motions)
    tracking_noise, torque_noise = comparison.noise
    done = {stage.name: ran for stage, ran in simulated if not ran.note}
    bags = tuple(motion.signals.name for motion in motions)
    return ReplayResult(
        robot=robot.name,
        joints=robot.joints,
        joint_types=robot.joint_types,
        bags=bags,
        duration=float(sum(len(m.position[m.span]) / m.signals.rate for m in motions)),
        software={"idim_iv_ros": version("idim-iv-ros"), "mujoco": version("mujoco")},
        model=str(model),
        effects="" if effects is None else str(effects),
        tracking_noise=dict(zip(robot.joints, tracking_noise.tolist(), strict=True)),
        torque_noise=dict(zip(robot.joints, torque_noise.tolist(), strict=True)),
        stages=tuple(comparison.stage(stage, ran) for stage, ran in simulated),
        held_out=None if not fitted else not any(bag in fitted for bag in bags),
        notes=(*prepared.doubts, *(note for stage in models for note in stage.notes), *notes),
        series=comparison.series(done),
    )


def _runs(
    prepared: PreparedRegression, fitted: Collection[str], effects: Sequence[SimulatedEffect]
) -> tuple[list[_Run], tuple[str, ...]]:
    """Return the recordings to replay (not those of the fit, if there are others), and notes."""
    parts = prepared.session.parts
    runs = [
        _Run(motion, law, part.start)
        for motion, law, part in zip(prepared.motions, _laws(prepared), parts, strict=True)
    ]
    held_out = [run for run, part in zip(runs, parts, strict=True) if part.bag not in fitted]
    runs = held_out or runs
    if any(BY_NAME[effect.effect].part == "gains" for effect in effects):
        return runs, ()
    beyond = [_feedforward(run) for run in runs]
    torques = [run.motion.filtered(run.motion.signals.torque) for run in runs]
    pairs = zip(beyond, torques, strict=True)
    shares = np.max([_rms(part) / np.maximum(_rms(whole), 1e-300) for part, whole in pairs], axis=0)
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


def _feedforward(run: _Run) -> FloatArray:
    """Return the recorded command less its law, (n_samples, n_joints) N m (N), smoothed."""
    signals = run.motion.signals
    speed = np.gradient(signals.position, 1.0 / signals.rate, axis=0)
    law = [
        CONTROL_LAW.parts(signals, run.law, joint, speed[:, joint]).command
        for joint in range(signals.position.shape[1])
    ]
    return run.motion.filtered(signals.torque - np.column_stack(law))


def _laws(prepared: PreparedRegression) -> tuple[ControlLaw, ...]:
    """Return the control law of each recording."""
    signals = [motion.signals for motion in prepared.motions]
    missing = [recording.name for recording in signals if recording.position_reference is None]
    if missing:
        raise DataError(
            f"{', '.join(missing)}: no reference to replay; name its topic as signals.reference"
        )
    motions, cutoffs = prepared.motions, prepared.cutoffs
    possible = instrument_sources(prepared.configuration, prepared.model, motions, cutoffs)
    sources, _ = with_law_speed(possible)
    source = sources.sources[0]
    if not isinstance(source, SimulatedLoop):
        raise DataError(" ".join(sources.controller) or "the control law is not known")
    return tuple(source.laws)


def _stages(
    mujoco: Any,
    prepared: PreparedRegression,
    model: FilePath,
    extended: EffectsFile,
    source: FilePath | None,
) -> list[StageModel]:
    """Return the available stages: nominal, corrected, with effects."""
    robot, base = prepared.model.robot, prepared.model.base
    if prepared.given is None:
        raise UsageError(prepared.why_no_given)
    stages = [nominal_stage(mujoco, prepared.model, prepared.configuration.robot.mjcf)]
    effects, parameters = extended.effects, extended.base_parameters
    joint_effects(effects, robot.joints)  # refuses what is not known before anything is simulated
    if str(model) != URDF:
        path = Path(model)
        stage = xml_stage(mujoco, robot, path, parameters)
        if source is not None:
            require_same_native(mujoco, path, effects, source)
        elif path.with_name(EFFECTS).is_file():
            left_out = path.with_name(EFFECTS)
            note = f"without the effects of {left_out}: add --effects {left_out}"
            stage = replace(stage, notes=(note,))
        # Constant torques are parameters that the XML has no place for.
        if not stage.effects:
            constant = [effect for effect in effects if BY_NAME[effect.effect].part == "offset"]
            stage = replace(stage, effects=tuple(constant))
        stages.append(stage)
    elif parameters:
        values = extended.changed(dict(zip(base.names, prepared.given, strict=True)))
        stages.append(plant_stage(mujoco, prepared.model, np.array(list(values.values()))))
    beyond = [effect for effect in effects if not BY_NAME[effect.effect].in_base_parameters]
    if beyond:
        stages.append(stages[-1].with_effects(beyond))
    return stages


def _simulate(
    mujoco: Any, robot: RobotModel, runs: Sequence[_Run], stage: StageModel
) -> _Simulated:
    """Simulate all recordings, each from its first sample with a filtered velocity."""
    positions: list[FloatArray] = []
    torques: list[FloatArray] = []
    for run in runs:
        motion, signals, first = run.motion, run.motion.signals, run.motion.span.start
        wanted, speed = signals.position_reference, signals.velocity_reference
        assert wanted is not None
        if speed is None:
            speed = np.gradient(wanted, 1.0 / signals.rate, axis=0)
        start, rate = motion.position[first], signals.rate
        moving, _ = central_differences(motion.position, rate=rate, start=first, stop=first + 1)
        when = run.start + first / rate
        references = References(rate, wanted[first:], speed[first:], start, moving[0], when)
        forward = run.law.feedforward
        law = replace(run.law, feedforward=None if forward is None else forward[first:])
        model = stage.compiled(mujoco)
        with mujoco_warnings():
            ran = run_in_mujoco(mujoco, model, robot, law, references, robot.given, stage.effects)
        if ran.diverged:
            return _Simulated(note=f"{signals.name}: {ran.diverged}")
        positions.append(motion.filtered(np.vstack([motion.position[:first], ran.position])))
        torques.append(motion.filtered(np.vstack([signals.torque[:first], ran.torque])))
    return _Simulated(positions, torques)


@dataclass(frozen=True)
class _Comparison:
    """Recordings, and the errors of simulations against them."""

    robot: RobotModel
    motions: Sequence[Motion]

    @cached_property
    def recorded(self) -> _Simulated:
        """Return the filtered recordings."""
        torques = [motion.filtered(motion.signals.torque) for motion in self.motions]
        return _Simulated([motion.position for motion in self.motions], torques)

    @cached_property
    def noise(self) -> list[FloatArray]:
        """Return RMS (n_joints,) of the noise that the filter removes: rad (m), and N m (N)."""
        signals = [motion.signals for motion in self.motions]
        deviations = []
        for raw, smooth in (
            ([recording.position for recording in signals], self.recorded.positions),
            ([recording.torque for recording in signals], self.recorded.torques),
        ):
            triples = zip(self.motions, raw, smooth, strict=True)
            taken = [(one - other)[motion.span] for motion, one, other in triples]
            deviations.append(np.asarray(np.nanstd(np.concatenate(taken), axis=0)))
        return deviations

    def stage(self, model: StageModel, ran: _Simulated) -> ReplayStage:
        """Return the errors of one stage; without numbers if its simulation failed."""
        if ran.note:
            return ReplayStage(model.name, model.words, None, None, None, ran.note)
        joints, recorded = self.robot.joints, self.recorded
        tracking = self._errors(joints, ran.positions, recorded.positions, self.noise[0])
        torque = self._errors(joints, ran.torques, recorded.torques, self.noise[1])
        tool = self._tool_error(ran.positions)
        return ReplayStage(model.name, model.words, tracking, torque, tool)

    def _tool_error(self, positions: Sequence[FloatArray]) -> ReplayError:
        """Return the error of the centre of the last link, m, for positions by recording."""
        tree = self.robot.pinocchio
        data, last = tree.createData(), tree.njoints - 1
        centre = np.array(tree.inertias[last].lever)

        def places(positions: FloatArray) -> FloatArray:
            where = np.empty((len(positions), 3))
            for row, position in enumerate(positions):
                pin.forwardKinematics(tree, data, position)
                where[row] = data.oMi[last].act(centre)
            return where

        apart = [
            np.linalg.norm(places(one) - places(other), axis=1, keepdims=True)
            for one, other in zip(positions, self.recorded.positions, strict=True)
        ]
        none = [np.zeros_like(rows) for rows in apart]
        return self._errors(("tool",), apart, none, np.zeros(1))["tool"]

    def _errors(
        self,
        names: Sequence[str],
        simulated: Sequence[FloatArray],
        recorded: Sequence[FloatArray],
        noise: FloatArray,
    ) -> dict[str, ReplayError]:
        """Return RMS errors over all recordings by name, with intervals and ratio to the noise.

        `simulated`, `recorded`: (n_samples, n_names) of each recording; `noise`: RMS (n_names,).
        """
        sums = []
        for motion, simulation, recording in zip(self.motions, simulated, recorded, strict=True):
            errors = np.nan_to_num((simulation - recording)[motion.span])
            (blocks,) = time_blocks([len(errors)], motion.signals.rate)
            sums.append(energies(errors, blocks))
        table = np.concatenate(sums)
        rms, drawn = roots(table.sum(axis=0)), roots(resampled(table))
        shares = np.divide(rms, noise, out=np.full_like(rms, np.nan), where=noise > 0.0)
        return {
            name: ReplayError(float(error), *interval(column), float(share))
            for name, error, column, share in zip(names, rms, drawn.T, shares, strict=True)
        }

    def series(self, stages: Mapping[str, _Simulated]) -> tuple[ReplaySeries, ...]:
        """Return thinned curves of the first recording with these stages."""
        motion = self.motions[0]
        reference, span = motion.signals.position_reference, motion.span
        assert reference is not None
        step = max(1, (span.stop - span.start) // settings.MOST_POINTS)
        thin = slice(span.start, span.stop, step)
        errors = {name: reference - stage.positions[0] for name, stage in stages.items()}
        return tuple(
            ReplaySeries(
                joint=joint,
                bag=motion.signals.name,
                time=np.arange(len(reference))[thin] / motion.signals.rate,
                error=(reference - motion.position)[thin, j],
                errors={name: error[thin, j] for name, error in errors.items()},
                torque=self.recorded.torques[0][thin, j],
                torques={name: stage.torques[0][thin, j] for name, stage in stages.items()},
            )
            for j, joint in enumerate(self.robot.joints)
        )


def _rms(values: FloatArray) -> FloatArray:
    """Return the RMS (n,) of columns over their finite values."""
    return np.asarray(np.sqrt(np.nanmean(values**2, axis=0)))
