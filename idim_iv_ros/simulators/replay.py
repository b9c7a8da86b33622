"""Replay of recorded references in MuJoCo: how far is the simulator from the robot?

Its models, a stage each, are made from the nominal model, or read from a file.
"""

import re
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
from idim_iv_ros.estimation.instruments import SimulatedLoop, instrument_sources
from idim_iv_ros.files import EFFECTS, FilePath, FilePaths, read_text
from idim_iv_ros.identification.prepare import PreparedRegression, prepare, read_configured
from idim_iv_ros.model import DynamicParameters, InverseModel, RobotModel, mjcf
from idim_iv_ros.progress import Progress, Stopwatch
from idim_iv_ros.signals.filters import central_differences
from idim_iv_ros.signals.motion import Motion
from idim_iv_ros.simulation import ControlLaw, SimulatedEffect
from idim_iv_ros.simulation.effects import contributions_of
from idim_iv_ros.simulators.effects_file import EffectsFile, constant_torques, read_effects
from idim_iv_ros.simulators.mujoco import (
    STIFFEST,
    add_motors,
    add_parts,
    nearest_parameters,
    plant_spec,
    set_inertias,
)
from idim_iv_ros.simulators.mujoco_loop import LONGEST_STEP, References, run_in_mujoco
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


@dataclass(frozen=True)
class StageModel:
    """Robot model of one stage of a replay."""

    name: str  # Of the stage
    words: str  # What the model is made of
    robot: RobotModel
    parameters: DynamicParameters | None  # None for a model that is read from `xml`
    xml: Path | None
    # Beyond the model: constant torques, which MuJoCo has no parameter for, are among them
    effects: tuple[SimulatedEffect, ...] = ()
    notes: tuple[str, ...] = ()

    def with_effects(self, effects: Sequence[SimulatedEffect]) -> "StageModel":
        """Return the model with effects, without those that elements of its file have already."""
        # Motors of a replay take the place of the file's actuators, and with them of their delay.
        # A model that is made here has no effect of its own.
        native = [bool(self.xml and e.native and BY_NAME[e.effect].element_of) for e in effects]
        ours = [replace(e, native=kept) for e, kept in zip(effects, native, strict=True)]
        words = f"{self.words}, with {', '.join(dict.fromkeys(e.effect for e in ours))}"
        return replace(self, name=WITH_EFFECTS, words=words, effects=(*self.effects, *ours))

    def compiled(self, mujoco: Any) -> Any:
        """Return the MuJoCo model, with a motor for each joint and the parts for effects."""
        if self.parameters is not None:
            spec = plant_spec(mujoco, self.robot, self.parameters)
        elif self.xml is not None:
            spec = _read_mjcf(mujoco, self.xml, self.robot.joints)
        with mjcf.mujoco_reads(self.xml or self.robot.name):
            add_motors(mujoco, spec, self.robot.joints)
            add_parts(spec, self.effects)
            model = spec.compile()
        bits = mujoco.mjtDisableBit
        for bit in (bits.mjDSBL_CONTACT, bits.mjDSBL_LIMIT, bits.mjDSBL_AUTORESET):
            model.opt.disableflags |= bit
        if self.parameters is not None:
            set_inertias(mujoco, model, self.robot, self.parameters)
            model.dof_solref[:] = (2.0 * LONGEST_STEP, 1.0)
            model.dof_solimp[:] = STIFFEST
        return model


def plant_stage(mujoco: Any, model: InverseModel, values: FloatArray | None = None) -> StageModel:
    """Return a stage from the nominal model, or with other base parameters (b,)."""
    robot = model.robot
    parameters = robot.given if values is None else nearest_parameters(model, values)
    plant_spec(mujoco, robot, parameters)  # refuses what cannot be simulated
    effects = constant_torques(robot.joints, dict(enumerate(parameters.offset)))
    name, words = NOMINAL, "the nominal model"
    if values is not None:
        name, words = CORRECTED, "the nominal model with found parameters"
    return StageModel(name, words, robot, parameters, None, effects)


def xml_stage(
    mujoco: Any, robot: RobotModel, path: Path, parameters: Mapping[str, float]
) -> StageModel:
    """Return the stage of an MJCF file, with constant torques among base parameters (off1 …)."""
    _read_mjcf(mujoco, path, robot.joints)
    constants = {}
    for name, value in parameters.items():
        if re.fullmatch(r"off\d+", name):
            constants[int(name[3:]) - 1] = value
            if not 1 <= int(name[3:]) <= len(robot.joints):
                raise UsageError(f"{name} is a parameter of a joint that the robot does not have")
    effects = constant_torques(robot.joints, constants)
    return StageModel(CORRECTED, path.name, robot, None, path, effects)


def require_same_native(
    mujoco: Any, path: Path, effects: Sequence[SimulatedEffect], source: FilePath
) -> None:
    """Check that no effect is simulated twice, or not at all.

    Raises UsageError: the MJCF has an effect as an element which `effects` do not mark as native,
    or the other way round.
    """
    model = mujoco.MjModel.from_xml_path(str(path))
    hint = f"the {path.name} and effects.json of one export belong together"
    elements = mjcf.native_elements(mujoco, model)
    for effect in effects:
        element = BY_NAME[effect.effect].element_of
        if not element or effect.joint is None:
            continue
        joints = elements.get(effect.effect, [])
        if element == "tendon":  # its first joint
            joints = [int(model.wrap_objid[model.tendon_adr[tendon]]) for tendon in joints]
        present = effect.joint in [model.joint(joint).name for joint in joints]
        what = f"{effect.effect} at {effect.joint}"
        if effect.native and not present:
            raise UsageError(
                f"{effect.source}: {what} is native, and {path} does not have it: {hint}"
            )
        if present and not effect.native:
            raise UsageError(
                f"{path}: has {what} as an element already, and {source} would add it again: {hint}"
            )


def _read_mjcf(mujoco: Any, path: Path, joints: Sequence[str]) -> Any:
    """Read an MJCF with the robot's joints, without actuators: the replay adds motors."""
    if not mjcf.is_mjcf(read_text(path, "the MJCF")):
        raise UsageError(
            f"{path}: is no MJCF: its first element is not <mujoco>; --model takes the .xml of "
            "`idim-iv export`, or `urdf` for the nominal model of the configuration"
        )
    with mjcf.mujoco_reads(path):
        spec = mujoco.MjSpec.from_file(str(path))
        model = spec.copy().compile()
    named = [joint.name for joint in spec.joints]
    missing = [name for name in joints if name not in named]
    if missing:
        raise UsageError(
            f"{path}: no joint {missing[0]}; its joints are {', '.join(filter(None, named))}: is "
            "this the model of another robot?"
        )
    others = [name or "an unnamed one" for name in named if name not in joints]
    if others:
        raise UsageError(
            f"{path}: its joint {others[0]} is not among robot.joints: a replay needs a model of "
            "these joints alone"
        )
    special = getattr(mujoco.mjtGain, "mjGAIN_DCMOTOR", -1)
    pairs = zip(spec.actuators, model.actuator_gaintype, strict=True)
    motors = [actuator for actuator, gain in pairs if gain != special]
    for member in (*reversed(motors), *spec.sensors, *spec.keys):
        spec.delete(member)
    return spec


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
class _Motions:
    """Filtered positions and torques of all recordings; of a simulation that failed, why."""

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

    - `model`: ``urdf``: a MuJoCo model is made from the nominal model of the configuration, with
      the base parameters of `effects` where these are given. Else an MJCF file of the corrected
      robot.
    - `effects`: a diagnosis (gap.json) or a file of effects
    - `stages`: names of the stages to simulate; all available ones by default

    Raises UsageError: MuJoCo is not installed, a file cannot be read or belongs to another robot,
    an effect is not known, or joints are coupled; DataError: the recordings have no references, or
    the control law is not known.
    """
    mujoco = mjcf.load_mujoco("a replay")
    with Stopwatch(progress) as watch:
        watch.stage("reading", 0.0)
        extended = EffectsFile() if effects is None else read_effects(Path(effects))
        prepared = prepare(read_configured(bags, configuration), configuration)
        possible = _stages(mujoco, prepared, model, extended, effects)
        models = [stage for stage in possible if stage.name in stages]
        fitted, robot = extended.recordings, prepared.model.robot
        planted = [effect for stage in possible for effect in stage.effects]
        runs, notes = _runs(prepared, fitted, planted)
        simulated = []
        for number, stage in enumerate(models):
            watch.stage(f"simulating: {stage.name}", 0.1 + 0.9 * number / len(models))
            simulated.append((stage, _simulate(mujoco, robot, runs, stage)))
    motions = [run.motion for run in runs]
    comparison = _Comparison(robot, motions)
    tracking_noise, torque_noise = comparison.noise
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
        series=comparison.series({stage.name: ran for stage, ran in simulated if not ran.note}),
    )


def _runs(
    prepared: PreparedRegression, fitted: Collection[str], effects: Sequence[SimulatedEffect]
) -> tuple[list[_Run], tuple[str, ...]]:
    """Return the recordings to replay (not those of the fit, if there are others), and notes."""
    parts, motions = prepared.session.parts, prepared.motions
    signals = [motion.signals for motion in motions]
    missing = [recording.name for recording in signals if recording.position_reference is None]
    if missing:
        raise DataError(
            f"{', '.join(missing)}: no reference to replay; name its topic as signals.reference"
        )
    sources, _ = with_law_speed(
        instrument_sources(prepared.configuration, prepared.model, motions, prepared.cutoffs)
    )
    source = sources.sources[0]
    if not isinstance(source, SimulatedLoop):
        raise DataError(" ".join(sources.controller) or "the control law is not known")
    runs = [
        _Run(motion, law, part.start)
        for motion, law, part in zip(motions, source.laws, parts, strict=True)
    ]
    held_out = [run for run, part in zip(runs, parts, strict=True) if part.bag not in fitted]
    runs = held_out or runs
    if any(BY_NAME[effect.effect].part == "gains" for effect in effects):
        return runs, ()
    beyond, shares = [], np.zeros(len(prepared.model.robot.joints))
    for run in runs:
        # The recorded command less its law.
        logged, law = run.motion.signals, run.law
        speed = np.gradient(logged.position, 1.0 / logged.rate, axis=0)
        gains = [CONTROL_LAW.parts(logged, law, j, v).command for j, v in enumerate(speed.T)]
        beyond.append(run.motion.filtered(logged.torque - np.column_stack(gains)))
        part, whole = (
            np.sqrt(np.nanmean(torque**2, axis=0))
            for torque in (beyond[-1], run.motion.filtered(logged.torque))
        )
        shares = np.maximum(shares, part / np.maximum(whole, 1e-300))
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
    # The user's MJCF, if its joints are the robot's.
    file, of_file = prepared.configuration.robot.mjcf, set[str]()
    if file is not None:
        with mjcf.mujoco_reads(file):
            of_file = {joint.name for joint in mujoco.MjSpec.from_file(str(file)).joints}
    if file is not None and of_file == set(robot.joints):
        nominal = xml_stage(mujoco, robot, file, {})
        stages = [replace(nominal, name=NOMINAL, words=f"{file.name} as given")]
    else:
        stages = [plant_stage(mujoco, prepared.model)]
    effects, parameters = extended.effects, extended.base_parameters
    contributions_of(effects, robot.joints)  # refuses, before anything is simulated
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


def _simulate(mujoco: Any, robot: RobotModel, runs: Sequence[_Run], stage: StageModel) -> _Motions:
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
        with mjcf.mujoco_warnings():
            ran = run_in_mujoco(mujoco, model, robot, law, references, robot.given, stage.effects)
        if ran.diverged:
            return _Motions(note=f"{signals.name}: {ran.diverged}")
        positions.append(motion.filtered(np.vstack([motion.position[:first], ran.position])))
        torques.append(motion.filtered(np.vstack([signals.torque[:first], ran.torque])))
    return _Motions(positions, torques)


@dataclass(frozen=True)
class _Comparison:
    """Recordings, and the errors of simulations against them."""

    robot: RobotModel
    motions: Sequence[Motion]

    @cached_property
    def torques(self) -> list[FloatArray]:
        """Filtered torques of the recordings."""
        return [motion.filtered(motion.signals.torque) for motion in self.motions]

    @cached_property
    def noise(self) -> list[FloatArray]:
        """RMS (n_joints,) of the noise that the filter removes: rad (m), and N m (N)."""
        positions, torques = [], []
        for motion, torque in zip(self.motions, self.torques, strict=True):
            positions.append((motion.signals.position - motion.position)[motion.span])
            torques.append((motion.signals.torque - torque)[motion.span])
        kinds = (positions, torques)
        return [np.asarray(np.nanstd(np.concatenate(parts), axis=0)) for parts in kinds]

    def stage(self, model: StageModel, ran: _Motions) -> ReplayStage:
        """Errors of one stage; without numbers if its simulation failed."""
        if ran.note:
            return ReplayStage(model.name, model.words, None, None, None, ran.note)
        joints, tree = self.robot.joints, self.robot.pinocchio
        data, last = tree.createData(), tree.njoints - 1
        centre = np.array(tree.inertias[last].lever)

        def place(position: FloatArray) -> FloatArray:
            pin.forwardKinematics(tree, data, position)
            return np.array(data.oMi[last].act(centre))

        tracking, tool = [], []
        for simulated, motion in zip(ran.positions, self.motions, strict=True):
            tracking.append(simulated - motion.position)
            apart = [place(q) - place(p) for q, p in zip(simulated, motion.position, strict=True)]
            tool.append(np.linalg.norm(apart, axis=1, keepdims=True))
        torque = [one - other for one, other in zip(ran.torques, self.torques, strict=True)]
        return ReplayStage(
            model.name,
            model.words,
            self._errors(joints, tracking, self.noise[0]),
            self._errors(joints, torque, self.noise[1]),
            self._errors(("tool",), tool, np.zeros(1))["tool"],
        )

    def _errors(
        self, names: Sequence[str], errors: Sequence[FloatArray], noise: FloatArray
    ) -> dict[str, ReplayError]:
        """RMS of errors (n_samples, n_names) by recording, with interval and ratio to the noise."""
        sums = []
        for motion, error in zip(self.motions, errors, strict=True):
            compared = np.nan_to_num(error[motion.span])
            (blocks,) = time_blocks([len(compared)], motion.signals.rate)
            sums.append(energies(compared, blocks))
        table = np.concatenate(sums)
        rms, drawn = roots(table.sum(axis=0)), roots(resampled(table))
        shares = np.divide(rms, noise, out=np.full_like(rms, np.nan), where=noise > 0.0)
        return {
            name: ReplayError(float(error), *interval(column), float(share))
            for name, error, column, share in zip(names, rms, drawn.T, shares, strict=True)
        }

    def series(self, stages: Mapping[str, _Motions]) -> tuple[ReplaySeries, ...]:
        """Thinned curves of the first recording with these stages."""
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
                torque=self.torques[0][thin, j],
                torques={name: stage.torques[0][thin, j] for name, stage in stages.items()},
            )
            for j, joint in enumerate(self.robot.joints)
        )
