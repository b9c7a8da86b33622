"""A mended simulator that is edited: the payload comes off, another tool goes on.

The protocol of the closest peer (SAPC, "Fidelity Is Not Identification", 2026): an FR3 of MuJoCo
Menagerie with a payload, other friction at joints 4 and 6, and a link 3 that is 12 % heavier is
the reference (implicit integrator, 0.5 ms). It is recorded on three motions, diagnosed and
exported; the exported twin (implicitfast, 1 ms) and the reference run two other motions under the
same law with the nominal model's feedforward, and the figure is the distance of their tools. What
the protocol leaves open is chosen here: the order of the random numbers (all sines, then all
cosines) and the centre of the motions, Menagerie's `home`. The figures are of the size of the
peer's and not the same: with the true parameters the twin is 1.97 times as far off as the peer's.

The same on a UR5e whose friction has effects that no number of an MJCF holds: at the elbow it
falls with speed, at the shoulder lift it grows with the torque of gravity. Menagerie damps this arm
with 200 N m s/rad in the place of a drive, and gives it no dry friction; here both have the size of
an arm's. Its dry friction is as stiff as MuJoCo allows, as that of a robot is.

    python -m benchmarks.twin --fr3 FR3.xml --ur5e UR5E.xml --out DIR [--noise 1 0 3]

The files are franka_fr3/fr3.xml (its bodies suffice) and universal_robots_ur5e/ur5e.xml of
Menagerie.
"""

import argparse
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks.measurement import write_page
from idim_iv_ros import diagnose, export
from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.recording.writing.write import JointTopic, write_bag
from idim_iv_ros.simulators.mujoco import STIFFEST, Effects
from idim_iv_ros.simulators.mujoco_parts import add_motors

FloatArray = NDArray[np.float64]
# What acts in a step beyond the model: friction that is no constant.
Apply = Callable[[mujoco.MjModel, mujoco.MjData], None]
FIT, VALIDATION = (1, 2, 3), (11, 12)
ENCODER, STEP, TORQUE = 1e-5, 1e-4, 0.05  # rad, rad, N m
USUAL, FAST = (0.35, 1.6, 8.0), (0.45, 2.5, 12.0)  # of the range, rad/s, rad/s²
MOTIONS = (USUAL, USUAL, USUAL, FAST, USUAL)
PEER = {"nominal": ("14.43", "2.60"), "true": ("0.0273", "0.0255"), "refit": ("0.027", "11.73"),
        "causes": ("–", "–"), "spread": ("0.030", "0.099")}  # fmt: skip


@dataclass(frozen=True)
class Tool:
    """A body at the flange: kg, m, kg m² about its centre."""

    mass: float
    centre: tuple[float, float, float]
    inertia: tuple[float, float, float]


PAYLOAD = Tool(0.8, (0.02, -0.015, 0.06), (1.5e-3, 1.5e-3, 0.8e-3))
OTHER = Tool(0.5, (-0.03, 0.02, 0.04), (1.0e-3, 1.0e-3, 0.5e-3))


@dataclass(frozen=True)
class Arm:
    """A robot of the benchmark, its law, and what is wrong with its nominal model.

    Attributes
    ----------
    joints : list of str
    kp, kd, limit : (n,)
        N m/rad, N m s/rad, N m.
    home : (n,) rad
        Centre of the motions.
    last, heavy : str
        The link that carries tools, and the one that is 12 % heavier.
    flange, turn : tuple of float
        Position (m) and quaternion of the flange in the last link.
    dry, viscous : dict of int to float
        True friction of joints, N m and N m s/rad; of the others it is nominal.
    beyond : Apply or None
        Friction that is no constant; called before each step of the reference.
    stiff : bool
        Whether dry friction of the reference is as stiff as MuJoCo allows; else its default.
    """

    joints: list[str]
    kp: FloatArray
    kd: FloatArray
    limit: FloatArray
    home: FloatArray
    last: str
    heavy: str
    flange: tuple[float, ...]
    turn: tuple[float, ...]
    dry: Mapping[int, float]
    viscous: Mapping[int, float]
    beyond: Apply | None = None
    stiff: bool = False


ELBOW, LIFT = 2, 1
ELBOW_DRY, EXCESS, STRIBECK_SPEED = 6.0, 3.0, 0.15  # N m, N m, rad/s
LIFT_DRY, LIFT_SHARE = 8.0, 0.1  # N m; of the torque of gravity and Coriolis forces


def friction_beyond(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Dry friction of the UR5e: it falls with speed at the elbow, grows with load at the lift."""
    slowness = np.exp(-((data.qvel[ELBOW] / STRIBECK_SPEED) ** 2))
    model.dof_frictionloss[ELBOW] = ELBOW_DRY + EXCESS * slowness
    model.dof_frictionloss[LIFT] = LIFT_DRY + LIFT_SHARE * abs(data.qfrc_bias[LIFT])


FR3 = Arm(
    joints=[f"fr3_joint{number}" for number in range(1, 8)],
    kp=np.array([300.0, 300.0, 300.0, 300.0, 120.0, 80.0, 40.0]),
    kd=np.array([30.0, 30.0, 30.0, 30.0, 12.0, 8.0, 4.0]),
    limit=np.array([87.0] * 4 + [12.0] * 3),
    home=np.array([0.0, 0.0, 0.0, -0.5, 0.0, 0.5, -0.25]) * np.pi,
    last="fr3_link7",
    heavy="fr3_link3",
    flange=(0.0, 0.0, 0.107),
    turn=(1.0, 0.0, 0.0, 0.0),
    dry={3: 2.8, 5: 1.1},
    viscous={3: 0.55},
)
UR5E = Arm(
    joints=[
        *("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint"),
        *(f"wrist_{number}_joint" for number in (1, 2, 3)),
    ],
    kp=np.array([1500.0, 1500.0, 1000.0, 200.0, 200.0, 100.0]),
    kd=np.array([120.0, 120.0, 60.0, 10.0, 10.0, 5.0]),
    limit=np.array([150.0] * 3 + [28.0] * 3),
    home=np.array([-0.5, -0.5, 0.5, -0.5, -0.5, 0.0]) * np.pi,
    last="wrist_3_link",
    heavy="forearm_link",
    flange=(0.0, 0.1, 0.0),
    turn=(1.0, -1.0, 0.0, 0.0),
    dry={3: 2.5},
    viscous={},
    beyond=friction_beyond,
    stiff=True,
)
UR5E_VISCOUS, UR5E_DRY = (5.0,) * 3 + (1.5,) * 3, (8.0, LIFT_DRY, ELBOW_DRY) + (1.5,) * 3


@dataclass(frozen=True)
class Simulated:
    """A robot in MuJoCo, and what acts on it beyond the model."""

    model: mujoco.MjModel
    apply: Apply | None = None


@dataclass(frozen=True)
class Motion:
    """Reference (samples, n) rad at 1 kHz, its derivative, and the nominal model's torque."""

    position: FloatArray
    velocity: FloatArray
    torque: FloatArray


def ur5e_nominal(path: Path, out: Path) -> Path:
    """Write Menagerie's UR5e without geometry and actuators, and with an arm's friction."""
    spec = mujoco.MjSpec.from_file(str(path))
    for kind in (spec.geoms, spec.meshes, spec.actuators, spec.keys):
        for part in list(kind):
            spec.delete(part)
    for joint, damping, friction in zip(spec.joints, UR5E_VISCOUS, UR5E_DRY, strict=True):
        joint.damping, joint.frictionloss = [damping, 0.0, 0.0], friction
    spec.compile()
    written = out / "ur5e_nominal.xml"
    written.write_text(spec.to_xml(), encoding="utf-8")
    return written


def specified(arm: Arm, path: Path, *, reference: bool, tool: Tool | None) -> mujoco.MjSpec:
    """A model of the file, with a tool; the reference has the other integrator and step."""
    spec = mujoco.MjSpec.from_file(str(path))
    kinds = mujoco.mjtIntegrator
    spec.option.integrator = kinds.mjINT_IMPLICIT if reference else kinds.mjINT_IMPLICITFAST
    spec.option.timestep = 0.5e-3 if reference else 1e-3
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    spec.body(arm.last).add_site(name="flange", pos=arm.flange)
    add_motors(mujoco, spec, arm.joints)
    if tool is not None:
        body = spec.body(arm.last).add_body(pos=arm.flange, quat=arm.turn)
        body.mass, body.ipos, body.inertia = tool.mass, tool.centre, tool.inertia
        body.explicitinertial = True
    return spec


def truth(arm: Arm, path: Path, tool: Tool | None, *, reference: bool = True) -> Simulated:
    """The robot: friction, and a link that is heavier."""
    model = specified(arm, path, reference=reference, tool=tool).compile()
    for joint, level in arm.dry.items():
        model.dof_frictionloss[joint] = level
    for joint, damping in arm.viscous.items():
        model.dof_damping[joint] = damping
    if arm.stiff:
        model.dof_solref[:], model.dof_solimp[:] = (2.0 * model.opt.timestep, 1.0), STIFFEST
    link = model.body(arm.heavy).id
    model.body_mass[link] *= 1.12
    model.body_inertia[link] *= 1.12
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return Simulated(model, arm.beyond)


def twin(arm: Arm, path: Path, tool: Tool | None = None, effects: Path | None = None) -> Simulated:
    """A file as the twin runs it, with its effects."""
    model = specified(arm, path, reference=False, tool=tool).compile()
    beyond = None if effects is None else Effects(model, effects)
    return Simulated(model, beyond.apply if beyond is not None and beyond.joints else None)


def motion(arm: Arm, nominal: mujoco.MjModel, seed: int, most: tuple[float, ...]) -> Motion:
    """Five harmonics of 0.1 Hz, scaled by joint to shares of range, speed, acceleration."""
    random, order, n = np.random.default_rng(seed), np.arange(1, 6), len(arm.joints)
    sine, cosine = (random.normal(size=(n, 5)) / order for _ in range(2))
    pulse = 2.0 * np.pi * 0.1 * order
    phase = np.outer(np.arange(20_000) / 1000.0, pulse)
    q = np.sin(phase) @ sine.T + np.cos(phase) @ cosine.T
    dq = np.cos(phase) @ (sine * pulse).T - np.sin(phase) @ (cosine * pulse).T
    ddq = -np.sin(phase) @ (sine * pulse**2).T - np.cos(phase) @ (cosine * pulse**2).T
    low, high = nominal.jnt_range.T
    limits = (most[0] * (high - low) / 2.0, most[1], most[2])
    peaks = (np.abs(values).max(axis=0) for values in (q, dq, ddq))
    scale = np.minimum.reduce([limit / peak for limit, peak in zip(limits, peaks, strict=True)])
    q, dq, ddq = arm.home + q * scale, dq * scale, ddq * scale
    data, torque = mujoco.MjData(nominal), np.empty_like(q)
    flags = nominal.opt.disableflags
    nominal.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)  # dry friction too
    for row in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[row], dq[row], ddq[row]
        mujoco.mj_inverse(nominal, data)
        torque[row] = data.qfrc_inverse
    nominal.opt.disableflags = flags
    return Motion(q, dq, torque)


def followed(
    arm: Arm, robot: Simulated, wanted: Motion
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Positions (s, n) rad, torques (s, n) N m and tool (s, 3) m under the law at 1 kHz."""
    model, data = robot.model, mujoco.MjData(robot.model)
    data.qpos[:], data.qvel[:] = wanted.position[0], wanted.velocity[0]
    mujoco.mj_forward(model, data)
    steps, site = round(1e-3 / model.opt.timestep), model.site("flange").id
    position, torque = np.empty_like(wanted.position), np.empty_like(wanted.position)
    tool = np.empty((len(position), 3))
    for row in range(len(position)):
        error, slip = wanted.position[row] - data.qpos, wanted.velocity[row] - data.qvel
        command = arm.kp * error + arm.kd * slip + wanted.torque[row]
        torque[row] = np.clip(command, -arm.limit, arm.limit)
        mujoco.mj_kinematics(model, data)
        position[row], tool[row] = data.qpos, data.site_xpos[site]
        data.ctrl[:] = torque[row]
        for _ in range(steps):
            if robot.apply is not None:
                robot.apply(model, data)
            mujoco.mj_step(model, data)
    return position, torque, tool


def recorded(arm: Arm, path: Path, out: Path, noise: float) -> list[Path]:
    """Bags of the reference with its payload; `noise`: times that of the protocol."""
    nominal, reference, bags = twin(arm, path).model, truth(arm, path, PAYLOAD), []
    for seed in FIT:
        wanted = motion(arm, nominal, seed, USUAL)
        position, torque, _ = followed(arm, reference, wanted)
        random = np.random.default_rng(100 + seed)
        position += noise * ENCODER * random.standard_normal(position.shape)
        torque += noise * TORQUE * random.standard_normal(torque.shape)
        if noise:
            position = np.round(position / STEP) * STEP
        clock = 100.0 * seed + np.arange(len(position)) / 1000.0
        bags.append(out / f"noise_{noise:g}_{seed}.mcap")
        states = JointTopic("/joint_states", arm.joints, clock, position, None, torque)
        asked = JointTopic("/joint_reference", arm.joints, clock, wanted.position, wanted.velocity)
        write_bag(bags[-1], [states, asked], force=True)
    return bags


def distance(
    arm: Arm, one: Simulated, other: Simulated, nominal: mujoco.MjModel, most: tuple[float, ...]
) -> float:
    """Root mean square distance of the tools on the motions held out, mm."""
    squares = []
    for seed in VALIDATION:
        wanted = motion(arm, nominal, seed, most)
        apart = followed(arm, one, wanted)[2] - followed(arm, other, wanted)[2]
        squares.append(np.mean(np.sum(apart**2, axis=1)))
    return 1000.0 * float(np.sqrt(np.mean(squares)))


def rows(arm: Arm, path: Path, folder: Path, configuration: Configuration) -> dict[str, str]:
    """Cells of the table by model: loaded, payload off, another tool, faster, off by itself."""
    nominal = twin(arm, path).model
    result = folder / "gap.json"
    named = GapResult.read(result).causes
    # A tool is a payload, or in the numbers of the last link where it may as well be.
    tools = [
        f"{cause.effect}@{cause.joint}"
        for cause in named
        if cause.effect in ("payload", "link_inertia") and cause.joint == arm.joints[-1]
    ]

    def exported(name: str, tool: Tool | None = None, **options: bool | list[str]) -> Simulated:
        made = export(result, configuration, folder / name, **options)  # type: ignore[arg-type]
        return twin(arm, made.mjcf, tool, made.effects)

    def edited(name: str, **options: bool) -> tuple[Simulated, ...]:
        bare = {"without": tools, **options}
        return (
            exported(name, **options),
            exported(f"{name}_bare", **bare),
            exported(f"{name}_bare", OTHER, **bare),
        )

    dense, last = exported("refit", refit=True), exported("refit", refit=True)
    # What a user can do with a dense refit: give the last link its nominal values again.
    link = last.model.body(arm.last).id
    for field in ("body_mass", "body_ipos", "body_iquat", "body_inertia"):
        getattr(last.model, field)[link] = getattr(nominal, field)[link]
    mujoco.mj_setConst(last.model, mujoco.MjData(last.model))
    models: dict[str, tuple[Simulated | None, ...]] = {
        "nominal": (twin(arm, path), twin(arm, path), twin(arm, path, OTHER)),
        "true": tuple(truth(arm, path, tool, reference=False) for tool in (PAYLOAD, None, OTHER)),
        "refit": (dense, last, None),
        "causes": edited("causes"),
        "spread": edited("spread", remainder=True),
    }
    if arm.beyond is not None:
        constants = edited("spread", remainder=True)
        models["constants"] = tuple(Simulated(robot.model) for robot in constants)
    references = [truth(arm, path, tool) for tool in (PAYLOAD, None, OTHER)]
    references += [references[0], truth(arm, path, None, reference=False)]
    cells = {}
    for name, robots in models.items():
        pairs = zip(references, (*robots, robots[0], robots[1]), strict=True)
        figures = [
            "–" if robot is None else f"{distance(arm, reference, robot, nominal, most):.3g}"
            for (reference, robot), most in zip(pairs, MOTIONS, strict=True)
        ]
        cells[name] = " | ".join(figures)
        print(name, cells[name], flush=True)
    return cells


WORDS = {
    "nominal": "nominal model",
    "true": "true parameters: another integrator and step",
    "refit": "all parameters (`--refit`), last link set back",
    "constants": "the last line without effects.json: what an MJCF holds",
    "causes": "nominal model and named causes",
    "spread": "**nominal model, named causes, what remains** (`--remainder`)",
}


def section(arm: Arm, title: str, path: Path, out: Path, noise: float) -> list[str]:
    """Record, diagnose, export, edit; lines of the page."""
    folder = out / f"{title.lower()}_{noise:g}"
    folder.mkdir(parents=True, exist_ok=True)
    configuration = Configuration.model_validate(
        {
            "robot": {"mjcf": path.resolve(), "joints": arm.joints},
            "controller": {"type": "unknown", "period": 0.001},
            "signals": {"joint_states": "joint_states", "reference": "joint_reference"},
        }
    )
    bags = recorded(arm, path, folder, noise)
    begin = time.perf_counter()
    gap = diagnose(bags, configuration)
    seconds = time.perf_counter() - begin
    gap.write(folder / "gap.json")
    cells = rows(arm, path, folder, configuration)
    published = PEER if arm is FR3 and noise == 1.0 else {}
    return [
        "",
        f"## {title}, noise × {noise:g}",
        "",
        "| | peer: loaded | peer: payload off | loaded | payload off | another tool | faster | "
        "payload off, numbers alone |",
        "|---|---:|---:|---:|---:|---:|---:|---:|",
        *(
            f"| {words} | {' | '.join(published.get(name, ('–', '–')))} | {cells[name]} |"
            for name, words in WORDS.items()
            if name in cells
        ),
        "",
        f"Diagnosis in {seconds:.0f} s. It names:",
        "",
        *(f"- {cause.sentence.split(';')[0]}." for cause in gap.causes),
        "",
        *(f"Hint: {hint.sentence}.\n" for hint in gap.hints),
        "Physical parameters: " + (gap.physical.sentence if gap.physical else gap.why_no_physical),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fr3", type=Path, help="MJCF with the bodies of Menagerie's FR3")
    parser.add_argument("--ur5e", type=Path, help="Menagerie's UR5e")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--noise", type=float, nargs="+", default=[1.0, 0.0, 3.0])
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    lines = [
        "Distance of the tools of twin and reference, rms over two motions held out, mm. Numbers "
        "alone: from the true parameters with the twin's integrator and step. The peer's figures "
        "are for its own order of random numbers and centre of motion, with half of this floor."
    ]
    for noise in arguments.noise if arguments.fr3 else ():
        lines += section(FR3, "FR3", arguments.fr3, arguments.out, noise)
    if arguments.ur5e:
        nominal = ur5e_nominal(arguments.ur5e, arguments.out)
        lines += section(UR5E, "UR5e", nominal, arguments.out, 1.0)
    write_page("twin", "A mended simulator that is edited", lines)


if __name__ == "__main__":
    main()
