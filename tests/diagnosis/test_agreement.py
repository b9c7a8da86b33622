"""Recordings that differ, in worlds where the torque of one of them has a change of its own.

The payload's torque comes from pinocchio's recursion on a heavier link, not from a regressor.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from bags.simulated_arms import arm2
from idim_iv_ros.diagnosis.against.changes import agreement
from idim_iv_ros.diagnosis.likelihood import Regression
from idim_iv_ros.diagnosis.refit.baseline import Baseline, baseline, smooth_regression
from idim_iv_ros.diagnosis.result import RecordingAgreement
from tests.diagnosis.worlds import point_mass
from tests.estimation.test_simulated_arms import recorded

NOISE = (0.15, 0.05)  # N m, of a row


@pytest.fixture(scope="module")
def data() -> Baseline:
    arm = arm2(seconds=8.0)
    return baseline([recorded(arm, seed) for seed in (1, 2, 3)], arm.configuration)


def world(data: Baseline, seed: int, change: Mapping[int, list[np.ndarray]]) -> Regression:
    """Rows whose torque is that of other parameters than the nominal, and changes by recording."""
    random = np.random.default_rng(seed)
    plain = smooth_regression(data)
    truth = 1.1 * data.prepared.model.given
    joints = []
    for joint, rows in enumerate(plain.joints):
        extra = data.counting(
            joint,
            [
                motion.rows(
                    change[number][joint] if number in change else np.zeros(len(motion.time))
                )
                for number, motion in enumerate(data.motions)
            ],
        )
        noise = NOISE[joint] * random.standard_normal(len(rows.torque))
        joints.append(replace(rows, torque=rows.matrix @ truth[rows.columns] + extra + noise))
    return Regression(tuple(joints), plain.parameters)


def differing(
    data: Baseline, seed: int, change: Mapping[int, list[np.ndarray]]
) -> dict[int, RecordingAgreement]:
    """Recordings that differ, by their number."""
    agreements = agreement(data, world(data, seed, change))
    assert [recording.bag for recording in agreements] == [
        part.bag for part in data.prepared.session.parts
    ]
    return {
        number: recording for number, recording in enumerate(agreements) if not recording.agrees
    }


def loaded(data: Baseline, number: int, mass: float) -> list[np.ndarray]:
    return point_mass(replace(data, motions=(data.motions[number],)), mass, (0.3, 0.0, 0.0))


def test_recordings_of_one_robot_agree_whatever_the_nominal_model(data: Baseline) -> None:
    assert all(differing(data, seed, {}) == {} for seed in range(5))


@pytest.mark.parametrize("number", [0, 1, 2])
@pytest.mark.parametrize("mass", [0.5, -0.5])
def test_the_recording_with_another_load_is_named_with_the_difference(data, number, mass) -> None:
    """Masses within three standard deviations; the loads of the others do not matter."""
    agreements = differing(data, 1, {number: loaded(data, number, mass)})
    assert set(agreements) == {number}
    (cause,) = agreements[number].differences
    assert cause.effect == "payload"
    parameter = cause.parameters["mass"]
    assert parameter.std is not None
    assert abs(parameter.value - mass) < 3.0 * parameter.std
    assert parameter.std < 0.1


def test_the_same_load_in_two_of_five_recordings_is_found_in_both() -> None:
    arm = arm2(seconds=8.0)
    five = baseline([recorded(arm, seed) for seed in (1, 2, 3, 4, 5)], arm.configuration)
    agreements = differing(five, 0, {number: loaded(five, number, 0.5) for number in (3, 4)})
    assert set(agreements) == {3, 4}
    for recording in agreements.values():
        (cause,) = recording.differences
        mass = cause.parameters["mass"]
        assert cause.effect == "payload" and mass.std is not None
        assert abs(mass.value - 0.5) < 3.0 * mass.std


def test_one_recording_is_held_against_nothing(data: Baseline) -> None:
    assert agreement(replace(data, motions=data.motions[:1]), smooth_regression(data)) == ()
