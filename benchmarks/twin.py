"""A mended simulator that is edited: the payload comes off, another tool goes on.

The protocol of the closest peer (SAPC, "Fidelity Is Not Identification", 2026): an FR3 of MuJoCo
Menagerie with a payload, other friction at joints 4 and 6, and a link 3 that is 12 % heavier is
the reference (implicit integrator, 0.5 ms). It is recorded on three motions, diagnosed and
exported; the exported twin (implicitfast, 1 ms) and the reference run two other motions under the
same law with the nominal model's feedforward, and the figure is the distance of their tools. What
the protocol leaves open is chosen here: the order of the random numbers (all sines, then all
cosines) and the centre of the motions, Menagerie's `home`. The figures are of the size of the
peer's and not the same.

    python -m benchmarks.twin FR3.xml --out DIR [--noise 1 0 3]

FR3.xml holds the bodies
of Menagerie's franka_fr3/fr3.xml.
"""

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks.measurement import write_page
from idim_iv_ros import diagnose, export
from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis.result import GapResult
from idim_iv_ros.recording import JointTopic, write_bag

FloatArray = NDArray[np.float64]
JOINTS = [f"fr3_joint{number}" for number in range(1, 8)]
KP = np.array([300.0, 300.0, 300.0, 300.0, 120.0, 80.0, 40.0])
KD = np.array([30.0, 30.0, 30.0, 30.0, 12.0, 8.0, 4.0])
LIMIT = np.array([87.0] * 4 + [12.0] * 3)
HOME = np.array([0.0, 0.0, 0.0, -0.5, 0.0, 0.5, -0.25]) * np.pi
FLANGE = (0.0, 0.0, 0.107)
FIT, HELD_OUT = (1, 2, 3), (11, 12)
ENCODER, STEP, TORQUE = 1e-5, 1e-4, 0.05  # rad, rad, N m
USUAL, FAST = (0.35, 1.6, 8.0), (0.45, 2.5, 12.0)  # of the range, rad/s, rad/s²
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
class Motion:
    """Reference (n, 7) rad at 1 kHz, its derivatives, and the nominal model's torque."""

    position: FloatArray
    velocity: FloatArray
    torque: FloatArray


def specified(path: Path, *, reference: bool, tool: Tool | None) -> mujoco.MjSpec:
    """A model of the file, with a tool; the reference has the other integrator and step."""
    spec = mujoco.MjSpec.from_file(str(path))
    kinds = mujoco.mjtIntegrator
    spec.option.integrator = kinds.mjINT_IMPLICIT if reference else kinds.mjINT_IMPLICITFAST
    spec.option.timestep = 0.5e-3 if reference else 1e-3
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    if tool is not None:
        body = spec.body("fr3_link7").add_body(pos=FLANGE)
        body.mass, body.ipos, body.inertia = tool.mass, tool.centre, tool.inertia
        body.explicitinertial = True
    return spec


def truth(path: Path, tool: Tool | None, *, reference: bool = True) -> mujoco.MjModel:
    """The robot: friction of joints 4 and 6, link 3."""
    model = specified(path, reference=reference, tool=tool).compile()
    model.dof_frictionloss[[3, 5]] = 2.8, 1.1
    model.dof_damping[3] = 0.55
    link = model.body("fr3_link3").id
    model.body_mass[link] *= 1.12
    model.body_inertia[link] *= 1.12
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def twin(path: Path, tool: Tool | None = None) -> mujoco.MjModel:
    """A file as the twin runs it."""
    return specified(path, reference=False, tool=tool).compile()


def motion(nominal: mujoco.MjModel, seed: int, most: tuple[float, float, float]) -> Motion:
    """Five harmonics of 0.1 Hz, scaled by joint to shares of range, speed, acceleration."""
    random, order = np.random.default_rng(seed), np.arange(1, 6)
    sine, cosine = (random.normal(size=(7, 5)) / order for _ in range(2))
    pulse = 2.0 * np.pi * 0.1 * order
    phase = np.outer(np.arange(20_000) / 1000.0, pulse)
    q = np.sin(phase) @ sine.T + np.cos(phase) @ cosine.T
    dq = np.cos(phase) @ (sine * pulse).T - np.sin(phase) @ (cosine * pulse).T
    ddq = -np.sin(phase) @ (sine * pulse**2).T - np.cos(phase) @ (cosine * pulse**2).T
    low, high = nominal.jnt_range.T
    limits = (most[0] * (high - low) / 2.0, most[1], most[2])
    peaks = (np.abs(each).max(axis=0) for each in (q, dq, ddq))
    scale = np.minimum.reduce([limit / peak for limit, peak in zip(limits, peaks, strict=True)])
    q, dq, ddq = HOME + q * scale, dq * scale, ddq * scale
    data, torque = mujoco.MjData(nominal), np.empty_like(q)
    flags = nominal.opt.disableflags
    nominal.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)  # dry friction too
    for row in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[row], dq[row], ddq[row]
        mujoco.mj_inverse(nominal, data)
        torque[row] = data.qfrc_inverse
    nominal.opt.disableflags = flags
    return Motion(q, dq, torque)


def followed(model: mujoco.MjModel, wanted: Motion) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Positions (n, 7) rad, torques (n, 7) N m and tool (n, 3) m under the law at 1 kHz."""
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = wanted.position[0], wanted.velocity[0]
    steps, site = round(1e-3 / model.opt.timestep), model.site("attachment_site").id
    position, torque = np.empty_like(wanted.position), np.empty_like(wanted.position)
    tool = np.empty((len(position), 3))
    for row in range(len(position)):
        error, slip = wanted.position[row] - data.qpos, wanted.velocity[row] - data.qvel
        torque[row] = np.clip(KP * error + KD * slip + wanted.torque[row], -LIMIT, LIMIT)
        mujoco.mj_kinematics(model, data)
        position[row], tool[row] = data.qpos, data.site_xpos[site]
        data.qfrc_applied[:] = torque[row]
        mujoco.mj_step(model, data, steps)
    return position, torque, tool


def recorded(path: Path, out: Path, noise: float) -> list[Path]:
    """Bags of the reference with its payload; `noise`: times that of the protocol."""
    nominal, reference, bags = twin(path), truth(path, PAYLOAD), []
    for seed in FIT:
        wanted = motion(nominal, seed, USUAL)
        position, torque, _ = followed(reference, wanted)
        random = np.random.default_rng(100 + seed)
        position += noise * ENCODER * random.standard_normal(position.shape)
        torque += noise * TORQUE * random.standard_normal(torque.shape)
        if noise:
            position = np.round(position / STEP) * STEP
        clock = 100.0 * seed + np.arange(len(position)) / 1000.0
        bags.append(out / f"noise_{noise:g}_{seed}.mcap")
        states = JointTopic("/joint_states", JOINTS, clock, position, None, torque)
        asked = JointTopic("/joint_reference", JOINTS, clock, wanted.position, wanted.velocity)
        write_bag(bags[-1], [states, asked], force=True)
    return bags


def distance(
    one: mujoco.MjModel, other: mujoco.MjModel, nominal: mujoco.MjModel, most: tuple[float, ...]
) -> float:
    """Root mean square distance of the tools on the motions held out, mm."""
    squares = []
    for seed in HELD_OUT:
        wanted = motion(nominal, seed, most)
        apart = followed(one, wanted)[2] - followed(other, wanted)[2]
        squares.append(np.mean(np.sum(apart**2, axis=1)))
    return 1000.0 * float(np.sqrt(np.mean(squares)))


def rows(
    path: Path, gap: GapResult, folder: Path, configuration: Configuration, noise: float
) -> list[str]:
    """Lines of the table: models by edits; the peer's figures are those of its noise."""
    nominal = twin(path)
    names = [each.effect for each in gap.causes if each.effect == "payload"]
    result = folder / "gap.json"

    def exported(name: str, **options: object) -> Path:
        return export(result, configuration, folder / name, **options).mjcf  # type: ignore[arg-type]

    whole, bare = exported("whole"), exported("bare", without=names)
    spread = exported("spread", remainder=True)
    spread_bare = exported("spread_bare", remainder=True, without=names)
    dense = exported("refit", refit=True)
    # What a user can do with a dense refit: give the last link its nominal values again.
    edited = twin(dense)
    last = edited.body("fr3_link7").id
    for each in ("body_mass", "body_ipos", "body_iquat", "body_inertia"):
        getattr(edited, each)[last] = getattr(nominal, each)[last]
    mujoco.mj_setConst(edited, mujoco.MjData(edited))
    models = {
        "nominal": (twin(path), twin(path), twin(path, OTHER)),
        "true": tuple(truth(path, each, reference=False) for each in (PAYLOAD, None, OTHER)),
        "refit": (twin(dense), edited, None),
        "causes": (twin(whole), twin(bare), twin(bare, OTHER)),
        "spread": (twin(spread), twin(spread_bare), twin(spread_bare, OTHER)),
    }
    words = {
        "nominal": "nominal model",
        "true": "true parameters: another integrator and step",
        "refit": "all parameters (`--refit`), last link set back",
        "causes": "nominal model and named causes",
        "spread": "**nominal model, named causes, what remains** (`--remainder`)",
    }
    references = [truth(path, each) for each in (PAYLOAD, None, OTHER)]
    lines = []
    for name, found in models.items():
        figures = [
            "–" if model is None else f"{distance(reference, model, nominal, USUAL):.3g}"
            for reference, model in zip(references, found, strict=True)
        ]
        figures.append(f"{distance(references[0], found[0], nominal, FAST):.3g}")
        published = PEER[name] if noise == 1.0 else ("–", "–")
        lines.append(f"| {words[name]} | {' | '.join(published)} | {' | '.join(figures)} |")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robot", type=Path, help="MJCF with the bodies of Menagerie's FR3")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--noise", type=float, nargs="+", default=[1.0, 0.0, 3.0])
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    configuration = Configuration.model_validate(
        {
            "robot": {"mjcf": arguments.robot.resolve(), "joints": JOINTS},
            "controller": {"type": "unknown", "period": 0.001},
            "signals": {"joint_states": "joint_states", "reference": "joint_reference"},
        }
    )
    lines = ["Distance of the tools of twin and reference, rms over two motions held out, mm."]
    for noise in arguments.noise:
        folder = arguments.out / f"noise_{noise:g}"
        folder.mkdir(exist_ok=True)
        bags = recorded(arguments.robot, arguments.out, noise)
        begin = time.perf_counter()
        gap = diagnose(bags, configuration)
        seconds = time.perf_counter() - begin
        gap.write(folder / "gap.json")
        lines += [
            "",
            f"## Noise × {noise:g}",
            "",
            "| | peer: loaded | peer: payload off | loaded | payload off | another tool | faster |",
            "|---|---:|---:|---:|---:|---:|---:|",
            *rows(arguments.robot, gap, folder, configuration, noise),
            "",
            f"Diagnosis in {seconds:.0f} s. It names:",
            "",
            *(f"- {each.sentence.split(';')[0]}." for each in gap.causes),
            "",
            "Physical parameters: " + (gap.physical.sentence if gap.physical else "none") + "",
        ]
    write_page("twin", "A mended simulator that is edited", lines)


if __name__ == "__main__":
    main()
