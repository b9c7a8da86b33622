"""Recordings of the project's own simulator, replayed in MuJoCo."""

import json
import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from bags import simulated_arms
from idim_iv_ros import load_configuration, replay_bags
from idim_iv_ros.configuration import Configuration, SimulatorSection
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.model import DynamicParameters, InverseModel, build_inverse_model, read_urdf_file
from idim_iv_ros.recording.writing.write import write_bag
from idim_iv_ros.report.replay import shrinkage, steps
from idim_iv_ros.report.section import Files
from idim_iv_ros.simulation import SimulatedEffect, inverse_dynamics, record_simulated_robot
from idim_iv_ros.simulator_files.export import Exported
from idim_iv_ros.simulators.mujoco import (
    add_motors,
    nearest_parameters,
    plant_spec,
    set_inertias,
)
from idim_iv_ros.simulators.replay_result import ReplayResult
from tests.cli.conftest import bag as robot_bag  # noqa: F401 (fixtures)
from tests.cli.conftest import record  # noqa: F401
from tests.simulator_files.cases import Case, case, cause

CONFIG = Path(__file__).resolve().parents[2] / "config"
PLANTED = SimulatedEffect("stribeck", "joint_1", {"excess": 1.5, "speed": 0.2})


@pytest.fixture(scope="module")
def configuration() -> Configuration:
    return load_configuration(CONFIG / "arm2.yaml")


def recorded_arm(path: Path, *, start: float = 0.0, feedforward: float = 0.0) -> Path:
    """Four seconds of the true arm with Stribeck friction.

    `feedforward`: size of a torque that the law adds at both joints, N m.
    """
    arm = simulated_arms.arm2(seconds=4.0)
    wave = np.sin(np.arange(len(arm.position_reference)) / arm.rate)
    recorded = record_simulated_robot(
        arm.robot,
        arm.truth,
        replace(arm.law, feedforward=feedforward * np.column_stack([wave, wave])),
        arm.position_reference,
        arm.velocity_reference,
        rate=arm.rate,
        seed=1,
        position_noise=2e-5,
        torque_noise=np.array([0.45, 0.175]),
        effects=[PLANTED],
    )
    topics = simulated_arms.joint_topics(arm, recorded)
    write_bag(path, [replace(topic, time=topic.time + start) for topic in topics])
    return path


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded_arm(tmp_path_factory.mktemp("replay") / "arm.mcap")


@pytest.fixture(scope="module")
def truth(configuration: Configuration, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What is true of that arm, as a file of effects."""
    arm = simulated_arms.arm2(seconds=4.0)
    model = inverse_model(configuration)
    values = model.base.from_standard(model.regressor.layout.vector(arm.truth))
    document = {
        "format": "idim_iv_ros/effects/1",
        "base_parameters": dict(zip(model.base.names, map(float, values), strict=True)),
        "effects": [
            {"effect": PLANTED.effect, "joint": PLANTED.joint, "parameters": PLANTED.parameters}
        ],
    }
    path = tmp_path_factory.mktemp("effects") / "effects.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def inverse_model(configuration: Configuration) -> InverseModel:
    urdf = configuration.robot.urdf
    return build_inverse_model(configuration, read_urdf_file(urdf), urdf.name)


def in_mujoco(model: InverseModel, parameters: DynamicParameters) -> mujoco.MjModel:
    spec = plant_spec(mujoco, model.robot, parameters)
    add_motors(mujoco, spec, model.robot.joints)
    compiled = spec.compile()
    set_inertias(mujoco, compiled, model.robot, parameters)
    return compiled


@pytest.mark.parametrize("name", ["arm2", "arm7"])
def test_the_plant_has_the_torques_of_the_model_with_any_base_parameters(name: str) -> None:
    model = inverse_model(load_configuration(CONFIG / f"{name}.yaml"))
    random = np.random.default_rng(3)
    values = model.given * (1.0 + 0.2 * random.uniform(-1, 1, len(model.given)))
    parameters = nearest_parameters(model, values)
    compiled = in_mujoco(model, parameters)
    compiled.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT  # dry friction
    data, n = mujoco.MjData(compiled), len(model.robot.joints)
    place = [compiled.joint(joint).qposadr[0] for joint in model.robot.joints]
    states = random.normal(size=(3, 10, n))
    expected = inverse_dynamics(model.robot, parameters.without_dry_friction, *states)
    torques = np.empty_like(expected)
    for k in range(10):
        data.qpos[place], data.qvel[place], data.qacc[place] = states[:, k]
        mujoco.mj_inverse(compiled, data)
        torques[k] = data.qfrc_inverse[place] + parameters.offset
    assert torques == pytest.approx(expected, abs=1e-9)
    by_regressor = model.matrix(*states) @ values
    dry = parameters.coulomb * np.sign(states[1])
    assert torques + dry == pytest.approx(by_regressor, abs=1e-8)


def test_errors_shrink_from_nominal_over_corrected_to_the_noise(bag, truth, configuration) -> None:
    result = replay_bags(bag, configuration, effects=truth)
    assert [stage.name for stage in result.stages] == ["nominal", "corrected", "with effects"]
    nominal, corrected, affected = (stage.tracking for stage in result.stages)
    errors = [stage["joint_1"].rms for stage in (nominal, corrected, affected)]
    assert errors[0] > 1.5 * errors[1] > 6.0 * errors[2]
    assert result.tracking_noise["joint_1"] == pytest.approx(2e-5, rel=0.3)
    for joint, level in (("joint_1", 0.45), ("joint_2", 0.175)):
        assert affected[joint].over_noise < 1.0
        assert affected[joint].low <= affected[joint].rms <= affected[joint].high
        assert result.torque_noise[joint] == pytest.approx(level, rel=0.15)
        # The filter lets a tenth of the white noise of the torque through, no more is left.
        assert result.stages[2].torque[joint].over_noise < 0.5
    text = result.to_json()
    assert ReplayResult.from_json(text, "replay.json").to_json() == text


def test_an_mjcf_is_the_corrected_model(bag, truth, configuration, tmp_path) -> None:
    """The true arm in a file with actuators of its own, which the law takes the place of."""
    text = mjcf(simulated_arms.arm2(seconds=4.0).truth)
    path = tmp_path / "arm2.xml"
    path.write_text(text, encoding="utf-8")
    result = replay_bags(bag, configuration, model=path, effects=truth)
    assert result.model == str(path)
    tracking = result.stages[2].tracking
    # MuJoCo's dry friction is as soft as the file has it at joints without effects.
    assert tracking["joint_1"].over_noise < 1.0 and tracking["joint_2"].over_noise < 5.0


def test_the_nominal_model_is_the_users_own_mjcf(bag, truth, configuration, tmp_path) -> None:
    """Actuators of the replay are motors, whatever the defaults of the file."""
    text = mjcf(simulated_arms.arm2(seconds=4.0).truth)
    default = '<default><general ctrlrange="-1 1" biastype="affine" biasprm="0 -9"/></default>'
    path, effects = tmp_path / "arm2.xml", tmp_path / "stribeck.json"
    path.write_text(text.replace("<mujoco>", f"<mujoco>{default}"), encoding="utf-8")
    effects.write_text(json.dumps(json.loads(truth.read_text()) | {"base_parameters": {}}))
    robot = configuration.robot.model_copy(update={"urdf": None, "mjcf": path})
    with_mjcf = configuration.model_copy(update={"robot": robot, "simulator": SimulatorSection()})
    nominal, affected = replay_bags(bag, with_mjcf, effects=effects).stages
    assert nominal.model == "arm2.xml as given"
    # Dry friction of the file is as soft as MuJoCo's default.
    assert nominal.tracking["joint_1"].over_noise > 10.0
    assert affected.tracking["joint_1"].over_noise < 5.0


def test_recordings_of_the_fit_are_left_out_where_there_are_others(
    bag: Path, truth: Path, configuration: Configuration, tmp_path: Path
) -> None:
    other, effects = recorded_arm(tmp_path / "other.mcap", start=100.0), tmp_path / "found.json"
    effects.write_text(json.dumps(json.loads(truth.read_text()) | {"recordings": [bag.name]}))
    alone = replay_bags(bag, configuration, effects=effects, stages=["nominal"])
    both = replay_bags([bag, other], configuration, effects=effects)
    assert (alone.bags, alone.held_out) == ((bag.name,), False)
    assert (both.bags, both.held_out) == ((other.name,), True)
    first = steps(both, Files("arm.yaml"))[0]
    assert first.code == f"idim-iv export {effects} --refit --config arm.yaml --out simulator"
    again = steps(alone, Files("arm.yaml"))[0].code  # they were diagnosed before
    assert "record" in again and "replay" in again and "diagnose" not in again
    rows = {row[0]: row for row in shrinkage(both)}
    joint, tool = rows["joint_1"], rows["end of the arm"]
    assert tool[5] == f"{100.0 * both.best.tool.rms / both.stages[0].tool.rms:.3g} %"
    given, after, interval = joint[1]
    assert given == ("full given", 0.0, 1.0)
    assert interval[1] < after[2] < interval[2] < 0.2


def test_what_the_law_adds_to_its_gains_is_that_of_the_recording(truth, configuration, tmp_path):
    bag = recorded_arm(tmp_path / "forward.mcap", feedforward=40.0)
    result = replay_bags(bag, configuration, effects=truth)
    assert any("commands more than its gains" in note for note in result.notes)
    nominal, best = result.stages[0].tracking, result.best.tracking
    assert nominal["joint_1"].over_noise > 20.0 and best["joint_1"].over_noise < 5.0


def mjcf(truth: DynamicParameters) -> str:
    """Text of an MJCF of the arm with inertias about the centres of mass."""
    bodies = ""
    for k, place in enumerate(("0 0 0.6", "0.42 0 0")):
        link = pin.Inertia.FromDynamicParameters(truth.inertial[k])
        # Of a planar arm only the moment about the axis counts; the others need only be possible.
        moment = 3 * [link.inertia[1, 1]]
        bodies += (
            f'<body name="l{k}" pos="{place}"><inertial mass="{link.mass:.15g}" '
            f'pos="{written(link.lever)}" diaginertia="{written(moment)}"/>'
            f'<joint name="joint_{k + 1}" axis="0 1 0" armature="{truth.drive_inertia[k]:.15g}" '
            f'damping="{truth.viscous[k]:.15g}" frictionloss="{truth.coulomb[k]:.15g}"/>'
        )
    return (
        f'<mujoco><worldbody>{bodies}</body></body></worldbody><actuator><position joint="joint_1" '
        'kp="7"/></actuator><keyframe><key name="home" qpos="0 0" ctrl="0"/></keyframe></mujoco>'
    )


def written(numbers: Iterable[float]) -> str:
    return " ".join(f"{number:.15g}" for number in numbers)


OTHER = '<mujoco><worldbody><body><joint name="elbow"/><geom size="1"/></body></worldbody></mujoco>'
MORE = OTHER.replace("elbow", "joint_1").replace(
    "<geom", '<joint name="joint_2" axis="0 1 0"/><joint name="finger" axis="1 0 0"/><geom'
)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (OTHER, "no joint joint_1; its joints are elbow"),
        (MORE, "its joint finger is not among robot.joints"),
        ("<mujoco><worldbody><bodi/></worldbody></mujoco>", "unrecognized element .*bodi"),
        (None, "cannot read the MJCF: No such file"),
    ],
)
def test_a_model_of_another_robot_is_refused(text, words, bag, configuration, tmp_path) -> None:
    path = tmp_path / "other.xml"
    if text is not None:
        path.write_text(text, encoding="utf-8")
    with pytest.raises(UsageError, match=words):
        replay_bags(bag, configuration, model=path)


def test_without_references_there_is_nothing_to_replay(bag: Path, tmp_path: Path) -> None:
    text = (CONFIG / "arm2.yaml").read_text().replace("  reference: joint_reference\n", "")
    text = text.replace("urdf: arm2.urdf", f"urdf: {CONFIG / 'arm2.urdf'}")
    path = tmp_path / "arm2.yaml"
    path.write_text(text)
    with pytest.raises(DataError, match=r"no reference to replay; name its topic"):
        replay_bags(bag, load_configuration(path))


NATIVE: list[dict[str, Any]] = [
    cause("nonlinear_viscous", "joint_1", coefficient=0.8, power=2.0),
    cause("spring", "joint_2", linear=1.5, quadratic=-0.2, cubic=0.3),
    cause("joint_coupling", "joint_1", direction=-1.0, coulomb=0.4, viscous=0.3, power=1.0)
    | {"other_joint": "joint_2"},
]


@pytest.fixture
def arm(tmp_path: Path) -> Case:
    return case(tmp_path, "arm2", NATIVE)


@pytest.fixture
def made(arm: Case, tmp_path: Path) -> Exported:
    return arm.export(tmp_path / "out")


def nominal(made: Exported, folder: Path, key: str, path: Path) -> Configuration:
    """The exported file as the nominal model, with the lines of changes.md."""
    section = re.search(r"```yaml\n(.*?)```", made.changes.read_text(encoding="utf-8"), re.S)
    text = (CONFIG / "arm2.yaml").read_text(encoding="utf-8")
    text = re.sub(r"simulator:\n  armature:.*\n", section[1], text, count=1)
    config = folder / f"{key}.yaml"
    config.write_text(text.replace("urdf: arm2.urdf", f"{key}: {path}"), encoding="utf-8")
    return load_configuration(config)


def errors(bag: Path, configuration: Configuration, model: Path, effects: Path, stage: str):
    """Tracking errors of one stage, (n_samples, n_joints) rad."""
    replayed = replay_bags(bag, configuration, model=model, effects=effects, stages=(stage,))
    return np.column_stack([series.errors[stage] for series in replayed.series])


def test_native_effects_are_simulated_once(
    arm: Case,
    made: Exported,
    robot_bag: Path,  # noqa: F811
    tmp_path: Path,
) -> None:
    """The same motion as with every effect at each step, in an XML that has none of them."""
    document = json.loads(made.effects.read_text(encoding="utf-8"))
    assert [effect["native"] for effect in document["effects"][:3]] == [True] * 3
    plain = case(tmp_path, "arm2").export(tmp_path / "plain")
    for effect in document["effects"]:
        effect["native"] = False
    callbacks = tmp_path / "callbacks.json"
    callbacks.write_text(json.dumps(document), encoding="utf-8")
    configuration = arm.configuration
    last = "with effects"
    native = errors(robot_bag, configuration, made.mjcf, made.effects, last)
    # The friction of both is as stiff: constant torques act on both joints.
    at_each_step = errors(robot_bag, configuration, plain.mjcf, callbacks, last)
    without = errors(robot_bag, configuration, plain.mjcf, plain.effects, "corrected")

    def rms(values: np.ndarray) -> float:
        return float(np.sqrt(np.mean(np.square(values))))

    # Twice or not at all would be as far away as the effects move the arm.
    assert rms(without - at_each_step) > 1e-3
    assert rms(native - at_each_step) < 0.02 * rms(without - at_each_step)


def test_files_of_two_exports_are_refused(
    arm: Case,
    made: Exported,
    robot_bag: Path,  # noqa: F811
    tmp_path: Path,
) -> None:
    plain = case(tmp_path, "arm2").export(tmp_path / "plain")
    for model, effects, words in (
        (plain.mjcf, made.effects, "nonlinear_viscous at joint_1 is native, and .* does not have"),
        (made.mjcf, case(tmp_path, "arm2", NATIVE).path, "has nonlinear_viscous at joint_1 as an"),
        (made.urdf, made.effects, "is no MJCF"),
        (made.effects, made.effects, "is no MJCF"),
        (made.mjcf, made.mjcf, "is XML, not effects"),
    ):
        with pytest.raises(UsageError, match=words):
            replay_bags(robot_bag, arm.configuration, model=model, effects=effects)


def test_constant_torques_of_an_export_are_parameters(
    robot_bag: Path,  # noqa: F811
    tmp_path: Path,
) -> None:
    """effects.json holds nothing else: the corrected robot is the whole answer."""
    arm = case(tmp_path, "arm2")
    made = arm.export(tmp_path / "out")
    assert made.not_native == ("torque_offset at joint_1", "torque_offset at joint_2")
    result = replay_bags(robot_bag, arm.configuration, model=made.mjcf, effects=made.effects)
    assert [stage.name for stage in result.stages] == ["nominal", "corrected"]
    (stage,) = replay_bags(
        robot_bag, arm.configuration, model=made.mjcf, stages=("corrected",)
    ).stages  # without them
    assert stage.torque != result.stages[1].torque
