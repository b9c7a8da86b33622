"""A nominal model without drive inertia, because its configuration says nothing of it."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from bags.simulated_arms import arm2, arm6
from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis.parametric.causes import parametric_causes, parametric_results
from idim_iv_ros.diagnosis.refit.baseline import Baseline, baseline, smooth_regression
from idim_iv_ros.diagnosis.refit.noise_floor import NoiseFloor
from idim_iv_ros.diagnosis.structural.likelihood import Regression
from tests.estimation.test_simulated_arms import recorded

NOISE = {2: (0.15, 0.05), 6: (0.2, 0.25, 0.13, 0.05, 0.04, 0.02)}  # N m, of a row
DRIVES = {2: (0.25, 0.1), 6: (0.9, 1.1, 0.55, 0.16, 0.12, 0.06)}  # kg m²


def without_armature(configuration: Configuration) -> Configuration:
    simulator = configuration.simulator.model_copy(update={"armature": None})
    return configuration.model_copy(update={"simulator": simulator})


@pytest.fixture(scope="module", params=[2, 6])
def data(request) -> Baseline:
    arm = arm2(seconds=12.0) if request.param == 2 else arm6(seconds=15.0)
    return baseline([recorded(arm, 1)], without_armature(arm.configuration))


def payload(data: Baseline, mass: float) -> np.ndarray:
    """Torque (n_samples, n_joints) of a mass at the last link, by pinocchio's own recursion."""
    robot = data.prepared.model.robot.pinocchio
    heavy = robot.copy()
    body = pin.Inertia(mass, np.array([0.06, 0.02, 0.05]), np.zeros((3, 3)))
    heavy.appendBodyToJoint(heavy.njoints - 1, body, pin.SE3.Identity())
    motion = data.motions[0]
    plain, loaded = robot.createData(), heavy.createData()
    return np.array(
        [
            pin.rnea(heavy, loaded, *state) - pin.rnea(robot, plain, *state)
            for state in zip(motion.position, motion.velocity, motion.acceleration, strict=True)
        ]
    )


def world(data: Baseline, seed: int, torque: np.ndarray) -> Regression:
    """The nominal model's torque, another torque (n_samples, n_joints), and noise."""
    random = np.random.default_rng(seed)
    plain = smooth_regression(data)
    given, noise = data.prepared.model.given, NOISE[len(data.joints)]
    motion = data.motions[0]
    joints = tuple(
        replace(
            each,
            torque=each.matrix @ given[each.columns]
            + motion.rows(torque[:, [joint]])[motion.kept[:, joint], 0]
            + noise[joint] * random.standard_normal(len(each.torque)),
        )
        for joint, each in enumerate(plain.joints)
    )
    return Regression(joints, plain.parameters)


def found(data: Baseline, seed: int, torque: np.ndarray):
    regression = world(data, seed, torque)
    return parametric_causes(data, regression, regression.fit()).causes


def drives(data: Baseline) -> np.ndarray:
    return data.motions[0].acceleration * DRIVES[len(data.joints)]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_drives_without_inertia_are_one_cause_with_the_value_of_each(data, seed: int) -> None:
    causes = found(data, seed, drives(data))
    assert [(cause.effect.name, cause.joint) for cause in causes] == [("drive_inertia", None)]
    grouped = {2: ["joint_1"], 6: ["joint_1", "joint_2"]}[len(data.joints)]
    rivals = [("link_inertia", joint) for joint in grouped]
    assert [(rival.effect, rival.joint) for rival in causes[0].indistinguishable_from] == rivals
    assert causes[0].share > 0.5
    for joint, true in zip(data.joints, DRIVES[len(data.joints)], strict=True):
        value = causes[0].parameters[joint]
        assert value.unit == "kg m²"
        assert value.std is not None
        assert abs(value.value - true) < 4.0 * value.std < 0.5 * true


def test_a_payload_that_is_there_as_well_is_named(data) -> None:
    mass = 0.8
    causes = found(data, 4, drives(data) + payload(data, mass))
    assert [cause.effect.name for cause in causes] == ["drive_inertia", "payload"]
    if len(data.joints) == 6:
        value = causes[1].parameters["mass"]
        assert value.std is not None
        assert abs(value.value - mass) < 4.0 * value.std < 0.5 * mass


def test_a_payload_alone_is_not_told_as_missing_drive_inertia(data) -> None:
    causes = found(data, 5, payload(data, 0.8))
    assert [cause.effect.name for cause in causes] == ["payload"]


def test_direct_drives_without_inertia_have_no_cause(data) -> None:
    for seed in range(3):
        assert found(data, seed, np.zeros_like(drives(data))) == ()


def test_the_sentence_names_every_drive(data) -> None:
    (cause,) = parametric_results(
        data,
        found(data, 1, drives(data)),
        [NoiseFloor(0.01, "lower bound", "")] * len(data.joints),
        [],
    )
    assert cause.sentence.startswith("the drives have inertia that the nominal model lacks")
    for joint in data.joints:
        assert f"{joint.replace('_', ' ')} " in cause.sentence
    assert cause.sentence.count("kg m²") == len(data.joints)


def test_armature_that_is_given_stays_a_cause_of_each_joint(data) -> None:
    n = len(data.joints)
    prepared = data.prepared
    simulator = prepared.configuration.simulator.model_copy(update={"armature": [0.0] * n})
    configuration = prepared.configuration.model_copy(update={"simulator": simulator})
    model = replace(prepared.model, robot=replace(prepared.model.robot, armature_given=True))
    known = replace(data, prepared=replace(prepared, configuration=configuration, model=model))
    assert all(cause.joint is not None for cause in found(known, 1, drives(data)))


@pytest.mark.parametrize(("scale", "said"), [(None, False), (1.0, False), (0.8, True)])
def test_a_mass_from_scaled_efforts_says_what_its_interval_lacks(data, scale, said) -> None:
    n = len(data.joints)
    causes = [each for each in found(data, 5, payload(data, 0.8)) if each.effect.name == "payload"]
    prepared = data.prepared
    signals = prepared.configuration.signals.model_copy(
        update={"effort_scale": None if scale is None else [scale] * n}
    )
    configuration = prepared.configuration.model_copy(update={"signals": signals})
    scaled = replace(data, prepared=replace(prepared, configuration=configuration))
    floors = [NoiseFloor(0.01, "lower bound", "")] * n
    (cause,) = parametric_results(scaled, causes, floors, [])
    assert ("takes signals.effort_scale as exact" in cause.sentence) == said
