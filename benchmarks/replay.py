"""Effects planted in a MuJoCo robot, diagnosed from its recordings, and replayed in MuJoCo.

The two-joint arm runs at a quarter of a millisecond with its true parameters, one effect and a
torque that no model explains; its law runs at 1 kHz, encoders and torques are noisy. `diagnose`
reads two recordings of it, `export` writes what it finds as an MJCF and effects.json, and these are
replayed with half a millisecond. How far is that from the recording, and how far is the true robot
without the unexplained torque?

    python -m benchmarks.replay --out DIR [EFFECT …]

measures all effects, or those that are named; what DIR holds already is kept.
"""

import argparse
import dataclasses
import json
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
import scipy
from numpy.typing import NDArray

from benchmarks.measurement import write_page
from idim_iv_ros import diagnose, export, load_configuration, replay_bags
from idim_iv_ros.configuration import Configuration
from idim_iv_ros.effects.registry import BY_NAME
from idim_iv_ros.excitation.excite import load_model, random_motion
from idim_iv_ros.excitation.trajectory import Trajectory
from idim_iv_ros.recording.writing.write import JointTopic, write_bag
from idim_iv_ros.simulation import SimulatedEffect
from idim_iv_ros.simulators.effects_file import read_effects
from idim_iv_ros.simulators.mujoco_loop import References, run_in_mujoco
from idim_iv_ros.simulators.recording import simulated_robot
from idim_iv_ros.simulators.replay import plant_stage
from idim_iv_ros.simulators.replay_result import CORRECTED, NOMINAL, WITH_EFFECTS

FloatArray = NDArray[np.float64]
CONFIG = Path(__file__).parent.parent / "config" / "arm2.yaml"
STEP = 0.25e-3  # s, of the robot
DISTURBANCE = 0.002  # of the torque limit, below 10 Hz: what no model explains
ENCODER, TORQUE = 2e-5, 0.005  # rad; of the torque limit
LIMIT = 1.2


@dataclass(frozen=True)
class Planted:
    """One effect, and how MuJoCo gets it."""

    effect: str
    joint: int
    numbers: dict[str, float]
    other: int | None = None
    how: str = "at each step"


PLANTED = (
    Planted("stribeck", 0, {"excess": 0.9, "speed": 0.1}),
    Planted("nonlinear_viscous", 0, {"coefficient": 0.5, "power": 2.0}),
    Planted("asymmetric_friction", 0, {"viscous": 0.4}),
    Planted("load_dependent_friction", 0, {"driving": 0.1, "driven": 0.1}),
    Planted("position_dependent_friction", 0, {"wave_number_1": 3.0, "sine_1": 0.6}),
    Planted("friction_drift", 0, {"time_constant": 40.0, "coulomb": 0.9}),
    Planted("presliding", 0, {"span_1": 0.01, "level_1": 1.1}),
    Planted("backlash", 1, {"gap": 0.006}, how="a second joint, and at each step"),
    Planted(
        "elasticity",
        1,
        {"stiffness": 500.0, "damping": 0.8},
        how="a second joint, and at each step",
    ),
    Planted("time_delay", 0, {"delay": 0.004}),
    Planted("torque_saturation", 0, {"knee": 22.0, "slope": 0.6}),
    Planted("position_ripple", 0, {"wave_number_1": 20.0, "sine_1": 0.6}),
    Planted("spring", 0, {"linear": 2.0, "cubic": 2.5}),
    Planted("encoder_eccentricity", 0, {"sine": 0.004, "cosine": 0.003}),
    Planted("joint_coupling", 0, {"coulomb": 0.4, "viscous": 0.3}, 1, "a tendon, and at each step"),
    Planted("controller_mismatch", 0, {"kp": 1000.0}, how="in the law of the replay"),
)


def motions(configuration: Configuration) -> list[Trajectory]:
    """A fast one, and a slow one through the range with small reversals."""
    time = np.arange(18_000) / 1000.0
    ramp = np.sin(np.pi * np.minimum(time, 1.0) / 2.0) ** 2
    position = np.empty((len(time), 2))
    for joint, (slow, size, fast) in enumerate(((0.11, 1.2, 0.9), (0.16, 1.1, 1.3))):
        position[:, joint] = ramp * (
            size * np.sin(2.0 * np.pi * slow * time)
            + 0.06 * np.sin(2.0 * np.pi * fast * time)
            + 0.02 * np.sin(2.0 * np.pi * 3.1 * fast * time)
        )
    velocity = np.gradient(position, 1e-3, axis=0)
    acceleration = np.gradient(velocity, 1e-3, axis=0)
    joints = tuple(configuration.robot.joints)
    slowly = Trajectory(joints, 1000.0, position, velocity, acceleration)
    return [random_motion(configuration, duration=15.0, rate=1000.0, seed=3), slowly]


def disturbance(configuration: Configuration, samples: int, seed: int) -> FloatArray:
    """Torque that no model explains, (samples, joints) N m."""
    limits = np.array(configuration.controller.torque_limit)
    white = np.random.default_rng(seed).standard_normal((samples, len(limits)))
    slow = scipy.signal.lfilter(*scipy.signal.butter(1, 10.0, fs=1000.0), white, axis=0)
    return np.asarray(slow / slow.std(axis=0) * DISTURBANCE * limits)


def recorded(
    configuration: Configuration, planted: Planted, trajectories: list[Trajectory], out: Path
) -> tuple[list[Path], Path]:
    """Run the robot; returns its bags, and what is true of it as a file of effects."""
    plain = simulated_robot(configuration)
    joints = configuration.robot.joints
    other = None if planted.other is None else joints[planted.other]
    effect = SimulatedEffect(planted.effect, joints[planted.joint], planted.numbers, other)
    stage = plant_stage(mujoco, load_model(configuration), np.array(list(plain.truth.values())))
    stage = stage.with_effects([effect])
    limits = np.array(configuration.controller.torque_limit)
    bags, start = [], 0.0
    for number, motion in enumerate(trajectories):
        noise = np.random.default_rng(100 + number)
        extra = disturbance(configuration, len(motion.position), 200 + number)
        law = replace(plain.law, feedforward=extra)
        references = References(
            1000.0, motion.position, motion.velocity, motion.position[0], motion.velocity[0], start
        )
        ran = run_in_mujoco(
            mujoco,
            stage.compiled(mujoco),
            stage.robot,
            law,
            references,
            plain.parameters,
            stage.effects,
            longest_step=STEP,
        )
        assert not ran.diverged, ran.diverged
        time = start + np.arange(len(motion.position)) / 1000.0
        position = ran.position + ENCODER * noise.standard_normal(ran.position.shape)
        torque = ran.torque - extra + TORQUE * limits * noise.standard_normal(ran.torque.shape)
        path = out / f"{planted.effect}-{number + 1}.mcap"
        topics = [
            JointTopic("/joint_states", joints, time, position, None, torque),
            JointTopic("/joint_reference", joints, time, motion.position, motion.velocity),
        ]
        write_bag(path, topics, force=True)
        bags.append(path)
        start += len(motion.position) / 1000.0 + 2.0
    truth = out / f"{planted.effect}.truth.json"
    document = {
        "format": "idim_iv_ros/effects/1",
        "base_parameters": plain.truth,
        "effects": [
            {
                "effect": planted.effect,
                "joint": effect.joint,
                "other_joint": other,
                "parameters": planted.numbers,
            }
        ],
    }
    truth.write_text(json.dumps(document), encoding="utf-8")
    return bags, truth


def case(
    configuration: Configuration, planted: Planted, trajectories: list[Trajectory], out: Path
) -> dict[str, object]:
    """Record, diagnose, export, replay: errors at the joint of the effect, mrad."""
    bags, truth = recorded(configuration, planted, trajectories, out)
    result = diagnose(bags, configuration)
    gap = out / f"{planted.effect}.gap.json"
    result.write(gap)
    made = export(gap, configuration, out / f"{planted.effect}.exported", refit=True)
    effects = read_effects(made.effects).effects
    beyond = any(not BY_NAME[effect.effect].in_base_parameters for effect in effects)
    last = WITH_EFFECTS if beyond else CORRECTED
    replayed = replay_bags(
        bags, configuration, model=made.mjcf, effects=made.effects, stages=(NOMINAL, last)
    )
    true = replay_bags(bags, configuration, effects=truth, stages=(WITH_EFFECTS,))
    joint = configuration.robot.joints[planted.joint]
    structural = [cause for cause in result.causes if cause.kind == "structural"]

    def rms(stage: object) -> float | None:
        tracking = getattr(stage, "tracking", None)
        return None if tracking is None else 1e3 * tracking[joint].rms

    return {
        **dataclasses.asdict(planted),
        "named": [f"{cause.effect} at {cause.joint}" for cause in structural],
        "native": sorted({effect.effect for effect in effects if effect.native}),
        "nominal": rms(replayed.stages[0]),
        "found": rms(replayed.stages[-1]),
        "true": rms(true.stages[-1]),
    }


def rows(cases: list[dict[str, object]]) -> list[str]:
    """Return the table of the page."""
    head = [
        "| effect | in MuJoCo | diagnosis says | element of the exported MJCF | nominal | with "
        "what was exported | with the true effect | exported / true |",
        "|---|---|---|---|---:|---:|---:|---:|",
    ]
    for one in cases:
        numbers = [one[key] for key in ("nominal", "found", "true")]
        shown = ["lost" if n is None else f"{n:.3f}" for n in numbers]  # type: ignore[str-format]
        ratio = "–"
        if one["found"] is not None and one["true"] is not None:
            ratio = f"{one['found'] / one['true']:.2f}"  # type: ignore[operator]
        named = ", ".join(one["named"]) or "nothing"  # type: ignore[arg-type]
        native = ", ".join(one["native"]) or "–"  # type: ignore[arg-type]
        head.append(
            f"| {one['effect']} | {one['how']} | {named} | {native} | {' | '.join(shown)} | "
            f"{ratio} |"
        )
    return head


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("effects", nargs="*")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    configuration = load_configuration(CONFIG)
    trajectories = motions(configuration)
    cases = []
    for planted in PLANTED:
        kept = arguments.out / f"{planted.effect}.json"
        if kept.exists() and planted.effect not in arguments.effects:
            cases.append(json.loads(kept.read_text()))
        elif not arguments.effects or planted.effect in arguments.effects:
            cases.append(case(configuration, planted, trajectories, arguments.out))
            kept.write_text(json.dumps(cases[-1]))
            print(rows(cases[-1:])[-1], flush=True)
    reached = [
        one
        for one in cases
        if one["found"] is not None and one["found"] <= LIMIT * one["true"]  # type: ignore[operator]
    ]
    lines = [
        f"Root mean square of simulated less recorded position at the joint of the effect, mrad. "
        f"{len(reached)} of {len(cases)} effects are replayed within {LIMIT:g} times the error "
        "with the true parameters and the true effect. What is then left is the robot's "
        f"unexplained torque ({100 * DISTURBANCE:g} % of the limit, below 10 Hz) and noise.",
        "",
        *rows(cases),
    ]
    missing = [p.effect for p in PLANTED if p.effect not in [one["effect"] for one in cases]]
    if missing:
        lines += ["", f"Not measured here: {', '.join(missing)}."]
    write_page("replay", "Effects planted in MuJoCo, diagnosed and replayed in MuJoCo", lines)


if __name__ == "__main__":
    main()
