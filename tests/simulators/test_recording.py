"""Bags of a configured simulated robot: truth, topics, noise, delay."""

import json
from pathlib import Path

import numpy as np
import pytest

from bags.simulated_arms import CONFIG, arm2, arm6, arm7
from benchmarks.paper_tx40.published import TABLE_1
from idim_iv_ros import Configuration, DataError, UsageError, load_configuration
from idim_iv_ros.excitation.excite import random_motion
from idim_iv_ros.identification.prepare import read_configured
from idim_iv_ros.model import build_inverse_model
from idim_iv_ros.signals.joint_side import joint_side
from idim_iv_ros.simulation import mass_matrix
from idim_iv_ros.simulators.recording import simulate, simulated_robot
from tests.inputs import changed


def configured(name: str, **simulated: object) -> Configuration:
    return changed(load_configuration(CONFIG / f"{name}.yaml"), "simulated_robot", **simulated)


@pytest.fixture(scope="module")
def motion():
    return random_motion(configured("arm2"), duration=2.0, rate=1000.0, seed=3)


@pytest.mark.parametrize("build", [arm2, arm6, arm7])
def test_configured_truth_is_that_of_the_physical_links_of_the_tests(build) -> None:
    """Links, centres of mass and drives, 10 to 30 % off: the same arms in both places."""
    arm = build(seconds=2.0)
    urdf = arm.configuration.robot.urdf
    model = build_inverse_model(arm.configuration, urdf.read_text(), urdf.name)
    physical = model.base.from_standard(model.regressor.layout.vector(arm.truth))
    truth = simulated_robot(arm.configuration).truth
    assert tuple(truth) == model.base.names
    np.testing.assert_allclose(list(truth.values()), physical, rtol=5e-5, atol=2e-6)


def test_tx40_is_that_of_table_1_and_its_mass_matrix_is_positive_everywhere() -> None:
    tx40 = simulated_robot(configured("tx40"))
    assert len(tx40.truth) == 60
    assert {name: tx40.truth[name] for name in TABLE_1} == {
        name: value for name, (value, _, _) in TABLE_1.items()
    }
    limits = tx40.robot.limits
    q = np.random.default_rng(1).uniform(limits.lower, limits.upper, (2000, 6))
    assert np.linalg.eigvalsh(mass_matrix(tx40.robot, tx40.parameters, q)).min() > 1e-3


def test_bags_hold_states_references_and_the_urdf(motion, tmp_path: Path) -> None:
    configuration = configured("arm2")
    bags, truth = simulate(configuration, tmp_path / "a.mcap", motion, seeds=[4, 9])
    assert [bag.path.name for bag in bags] == ["a-4.mcap", "a-9.mcap"]
    written = json.loads(truth.read_text())
    assert written.pop("format") == "idim_iv_ros/truth/1"
    assert written == simulated_robot(configuration).truth
    first, second = read_configured([bag.path for bag in bags], configuration)
    assert first.rate == pytest.approx(1000.0)
    assert first.robot_description == configuration.robot.urdf.read_text()
    np.testing.assert_allclose(first.position_reference.values, motion.position, atol=1e-9)
    np.testing.assert_allclose(first.velocity_reference.values, motion.velocity, atol=1e-9)
    noise = first.effort.values - second.effort.values
    np.testing.assert_allclose(noise.std(axis=0), np.sqrt(2) * np.array([0.45, 0.175]), rtol=0.1)


def test_motor_side_offsets_and_scale_come_back_as_joint_signals(motion, tmp_path: Path) -> None:
    plain = configured("arm2")
    changed = plain.model_copy(
        update={
            "robot": plain.robot.model_copy(
                update={
                    "motor_to_joint": [[30.0, 0.0], [12.0, -45.0]],
                    "position_offset": [0.1, -0.2],
                }
            ),
            "signals": plain.signals.model_copy(update={"effort_scale": [2.0, 0.5]}),
        }
    )
    records = []
    for name, configuration in (("plain", plain), ("motor", changed)):
        bags, _ = simulate(configuration, tmp_path / f"{name}.mcap", motion)
        read = read_configured([bags[0].path], configuration)
        records.append(joint_side(read[0], configuration))
    joint, motor = records
    np.testing.assert_allclose(motor.position, joint.position, atol=1e-12)
    np.testing.assert_allclose(motor.torque, joint.torque, atol=1e-10)
    np.testing.assert_allclose(motor.position_reference, joint.position_reference, atol=1e-12)


def test_the_true_delay_is_that_of_the_simulated_robot(motion) -> None:
    """8 ms from the command to the joint; at a sample the mean of both sides acts."""
    truth = simulated_robot(configured("arm2", delay=0.008)).record(motion, 1).truth
    expected = 0.5 * (truth.torque[42:-8] + truth.torque[41:-9])
    np.testing.assert_allclose(truth.applied_torque[50:], expected, atol=1e-9)


def test_what_cannot_be_simulated_is_refused_in_one_line(motion, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"simulated_robot.parameters: ZZ9 is not a base"):
        simulated_robot(configured("arm2", parameters={"ZZ9": 1.0}))
    with pytest.raises(UsageError, match=r"does not divide"):
        simulated_robot(configured("arm2", rate=700.0)).record(motion, 1)
    with pytest.raises(DataError, match=r"cannot run this trajectory.*positive definite.*"):
        simulated_robot(configured("arm2", parameters={"YY1": -9.0})).record(motion, 1)
    with pytest.raises(UsageError, match=r"twice"):
        simulate(configured("arm2"), tmp_path / "a.mcap", motion, seeds=[1, 1])
    with pytest.raises(UsageError, match="no folder"):
        simulate(configured("arm2"), tmp_path / "none" / "a.mcap", motion)
    assert list(tmp_path.iterdir()) == []
