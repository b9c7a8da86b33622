"""What `diagnose --against` says of two sets of recordings whose difference is known.

    python -m benchmarks.contrast --out DIR [--only NAME] [--judged] [--page]

Every robot is drawn anew: its parameters are 10 to 30 % off the nominal model in both sets. The
first set is recorded on the plant of `withheld_effects`, the second on the same plant or in
MuJoCo's own `mj_step`, which then is the simulator of the robot. Both sets have two recordings of
motions of their own. `changed` is the one effect that one set has; `common` is one that both have.
Only the contrast is computed, not the diagnosis of the first set that `diagnose --against` adds.
"""

import argparse
import json
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np

from benchmarks.measurement import write_page
from benchmarks.withheld_effects.calibration import Course, calibrate, session
from benchmarks.withheld_effects.effects import EFFECTS
from benchmarks.withheld_effects.motion import rich_motion
from benchmarks.withheld_effects.robot import given_robot, rigid_body_model
from benchmarks.withheld_effects.world import FloatArray, World, plain_world, record
from idim_iv_ros import load_configuration
from idim_iv_ros.compilation import one_thread
from idim_iv_ros.diagnosis.against.contrast import contrasted
from idim_iv_ros.diagnosis.result.recordings import ContrastResult
from idim_iv_ros.identification.prepare import read_configured
from idim_iv_ros.recording.writing.write import JointTopic, write_bag

STEPS = 16  # of MuJoCo's plant in one period of the law
SMOOTH = 0.001  # rad/s, below which its dry friction falls to zero
SETTLE = 1000  # periods at the first reference

Signals = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True)
class Cell:
    """One pair of sets.

    Attributes
    ----------
    robot : str
    changed, common : (effect, joint, ratio to the noise floor) or None
    mujoco : bool
        Whether the second set comes from MuJoCo.
    vanishes : bool
        Whether the first set has what changed.
    slower : int
        Every so many samples of the second set are recorded.
    seconds : float
        Of each recording.
    """

    robot: str
    changed: tuple[str, int, float] | None = None
    common: tuple[str, int, float] | None = None
    mujoco: bool = False
    vanishes: bool = False
    slower: int = 1
    seconds: float = 15.0

    @property
    def name(self) -> str:
        """File name."""
        parts = [self.robot]
        for word, effect in (("changed", self.changed), ("common", self.common)):
            if effect is not None:
                parts.append(f"{word}-{effect[0]}-{effect[1] + 1}")
        flags = {"mujoco": self.mujoco, "vanishes": self.vanishes, "slower": self.slower > 1}
        return "_".join([*parts, *(name for name, on in flags.items() if on)])


def cells() -> Iterator[Cell]:
    """All of them."""
    arm2 = "arm2"
    for common in (None, ("stribeck", 0, 2.0), ("load_dependent_friction", 1, 2.0)):
        yield Cell(arm2, common=common)
        yield Cell(arm2, common=common, slower=2)
    yield Cell(arm2, mujoco=True)
    yield Cell(arm2, mujoco=True, slower=2)
    yield Cell(arm2, changed=("payload", 1, 2.0))
    yield Cell(arm2, changed=("payload", 1, 2.0), common=("load_dependent_friction", 0, 2.0))
    yield Cell(arm2, changed=("payload", 1, 2.0), mujoco=True)
    yield Cell(arm2, changed=("payload", 1, 2.0), common=("stribeck", 1, 2.0), slower=2)
    yield Cell(arm2, changed=("friction_level", 0, 2.0))
    yield Cell(arm2, changed=("friction_level", 1, 2.0), mujoco=True)
    yield Cell(arm2, changed=("friction_level", 1, 2.0), common=("elasticity", 0, 2.0))
    for joint in (0, 1):
        yield Cell(arm2, changed=("stribeck", joint, 2.0))
        yield Cell(arm2, changed=("stribeck", joint, 2.0), vanishes=True, slower=2 - joint)
        yield Cell(arm2, changed=("gain", joint, 1.0), slower=1 + joint)
        yield Cell(arm2, changed=("time_delay", joint, 2.0), slower=2 - joint)
        yield Cell(arm2, changed=("load_dependent_friction", joint, 2.0), vanishes=joint == 1)
    yield Cell(arm2, changed=("stribeck", 0, 2.0), vanishes=True, mujoco=True)
    yield Cell(arm2, changed=("load_dependent_friction", 0, 2.0), vanishes=True, mujoco=True)
    yield Cell("arm6", seconds=18.0)
    yield Cell("arm6", changed=("payload", 5, 3.0), seconds=18.0)


def write_cell(folder: Path, cell: Cell, seed: int) -> tuple[list[Path], list[Path]]:
    """Draw the robot, calibrate what it has, record both sets."""
    given = given_robot(cell.robot)
    streams = np.random.SeedSequence([20261, seed]).spawn(4)
    robot, motion, shape, noise = (np.random.default_rng(stream) for stream in streams)
    world = plain_world(given, robot, altered=True)
    courses = [
        Course(*rich_motion(given, motion, cell.seconds), int(noise.integers(2**31)))
        for _ in range(4)
    ]
    floor = session(world, courses[:2])
    both, one = (
        _applied(world, asked, shape, courses[:2], floor) for asked in (cell.common, cell.changed)
    )
    plain = both(world)
    worlds = (one(plain), plain) if cell.vanishes else (plain, one(plain))
    folder.mkdir(parents=True, exist_ok=True)
    sets: tuple[list[Path], list[Path]] = ([], [])
    for number, course in enumerate(courses):
        which = number // 2
        simulated = cell.mujoco and which == 1
        signals = (
            _in_mujoco(worlds[which], course) if simulated else _on_plant(worlds[which], course)
        )
        every = cell.slower if which else 1
        path = folder / f"{'AB'[which]}{number % 2 + 1}.mcap"
        stamps, *rest = (signal[::every] for signal in signals)
        stamps = stamps + 100.0 * (1 + number)
        position, velocity, effort, wanted, speed = rest
        joints = given.joints
        write_bag(
            path,
            [
                JointTopic("/joint_states", joints, stamps, position, velocity, effort),
                JointTopic("/joint_reference", joints, stamps, wanted, speed),
            ],
        )
        sets[which].append(path)
    return sets


def _applied(world, asked, shape, courses, floor) -> Callable[[World], World]:
    """Return what gives a robot an effect of the wanted size; another gain is 15 % off."""
    if asked is None:
        return lambda robot: robot
    name, joint, rho = asked
    if name == "gain":

        def softer(robot: World) -> World:
            kp = robot.controller.kp.copy()
            kp[joint] *= 0.85
            return replace(robot, controller=robot.controller._replace(kp=kp))

        return softer
    effect = EFFECTS[name](shape, world.given, joint)
    strength = calibrate(world, effect, courses, floor, rho).strength
    return lambda robot: effect.apply(robot, strength)


def _on_plant(world: World, course: Course) -> Signals:
    made = record(world, course.position, course.velocity, course.seed)
    return (
        made.time,
        made.position,
        made.velocity,
        made.effort,
        made.position_reference,
        made.velocity_reference,
    )


def _in_mujoco(world: World, course: Course) -> Signals:
    """The same robot in MuJoCo: its own integrator, a command that is held and recorded as set.

    Dry and viscous friction and breakaway alone; a simulator has no noise.
    """
    law, drive = world.controller, world.drive
    model = rigid_body_model(world.given, world.inertials, world.gravity)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.opt.timestep = law.period / STEPS
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    model.jnt_limited[:] = 0
    model.dof_armature[:] = drive.inertia
    model.dof_damping[:] = drive.viscous_forward
    model.dof_frictionloss[:] = 0.0
    mujoco.mj_setConst(model, mujoco.MjData(model))
    data = mujoco.MjData(model)
    position = np.concatenate([np.tile(course.position[0], (SETTLE, 1)), course.position])
    velocity = np.concatenate([np.zeros((SETTLE, position.shape[1])), course.velocity])
    data.qpos[:] = position[0]
    rows = []
    for wanted, speed in zip(position, velocity, strict=True):
        command = law.kp * (wanted - data.qpos) + law.kd * (speed - data.qvel)
        command = np.clip(command, -law.limit, law.limit)
        rows.append(np.concatenate([data.qpos, data.qvel, command]))
        for _ in range(STEPS):
            way = np.tanh(data.qvel / SMOOTH)
            slow = np.abs(data.qvel) / drive.breakaway_speed
            dry = drive.dry_forward + drive.breakaway * np.exp(-(slow**drive.breakaway_exponent))
            data.qfrc_applied[:] = command - dry * way
            mujoco.mj_step(model, data)
    table = np.array(rows)[SETTLE:]
    n = position.shape[1]
    stamps = np.arange(len(table)) * law.period
    return (
        stamps,
        table[:, :n],
        table[:, n : 2 * n],
        table[:, 2 * n :],
        course.position,
        course.velocity,
    )


@dataclass(frozen=True)
class CellScore:
    """Whether what changed was named, and what else was."""

    named: bool
    others: tuple[str, ...]
    sentence: str
    seconds: float


def judge(cell: Cell, result: ContrastResult, seconds: float) -> CellScore:
    """Hold the answer against what was built in; a load belongs to no joint."""
    joints = load_configuration(given_robot(cell.robot).yaml).robot.joints
    wanted: set[tuple[str, str | None]] = set()
    if cell.changed is not None:
        name, joint, _ = cell.changed
        name = "controller_mismatch" if name == "gain" else name
        wanted = (
            {(name, joints[joint]), (name, None)} if name == "payload" else {(name, joints[joint])}
        )
    named, others = False, []
    for cause in result.causes:
        mine = {(cause.effect, cause.joint)}
        mine |= {(other.effect, other.joint) for other in cause.indistinguishable_from}
        if wanted & mine:
            named = True
        else:
            others.append(f"{cause.effect} at {cause.joint}")
    others += list(result.unattributed)
    return CellScore(named, tuple(others), result.sentence, seconds)


def run(out: Path, only: str = "", *, stored_only: bool = False) -> list[tuple[Cell, CellScore]]:
    """Write, diagnose and judge the cells; those that were judged before are read.

    `stored_only`: judge no others.
    """
    scores = []
    for seed, cell in enumerate(cells()):
        if only and only not in cell.name:
            continue
        folder = out / f"{seed:02d}_{cell.name}"
        file = folder / "judged.json"
        if stored_only and not file.is_file():
            continue
        if file.is_file():
            document = json.loads(file.read_text())
            score = CellScore(
                document["named"],
                tuple(document["others"]),
                document["sentence"],
                document["seconds"],
            )
        else:
            reference, against = write_cell(folder, cell, seed)
            configuration = load_configuration(given_robot(cell.robot).yaml)
            started = time.perf_counter()
            with one_thread():
                sets = [read_configured(bags, configuration) for bags in (reference, against)]
                result = contrasted(*sets, configuration)
            score = judge(cell, result, time.perf_counter() - started)
            file.write_text(json.dumps(vars(score)))
        print(
            f"{folder.name}: named {score.named}, others {list(score.others)}, "
            f"{score.seconds:.0f} s"
        )
        print(f"    {score.sentence}", flush=True)
        scores.append((cell, score))
    return scores


def page_lines(scores: list[tuple[Cell, CellScore]]) -> list[str]:
    """Figures and one row for each cell."""
    changed = [score for cell, score in scores if cell.changed is not None]
    same = [score for cell, score in scores if cell.changed is None]
    named = sum(score.named for score in changed)
    alone = sum(not score.others for score in changed)
    quiet = sum(not score.others for score in same)
    lines = [
        f"Cells that were judged: {len(scores)} of {len(list(cells()))}.",
        "",
        "| figure | found | target |",
        "|---|---|---|",
        f"| what changed is named | {named} of {len(changed)} | ≥ 85 % |",
        f"| nothing else is named beside it | {alone} of {len(changed)} | ≥ 90 % |",
        f"| nothing changed: nothing is named | {quiet} of {len(same)} | all |",
        "",
        "| cell | named | beside it | s |",
        "|---|---|---|---|",
    ]
    for cell, score in scores:
        hit = "–" if cell.changed is None else "yes" if score.named else "no"
        lines.append(
            f"| {cell.name} | {hit} | {'; '.join(score.others) or '–'} | {score.seconds:.0f} |"
        )
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--only", default="", help="cells whose name holds this")
    parser.add_argument("--judged", action="store_true", help="only those judged before")
    parser.add_argument("--page", action="store_true", help="write benchmarks/results/contrast.md")
    arguments = parser.parse_args()
    scores = run(arguments.out, arguments.only, stored_only=arguments.judged)
    if arguments.page:
        write_page("contrast", "Contrast of two sets of recordings", page_lines(scores))
    else:
        print("\n".join(page_lines(scores)))


if __name__ == "__main__":
    main()
