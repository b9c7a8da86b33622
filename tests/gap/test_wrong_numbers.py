"""Which given number is wrong, in worlds whose torque is that of changed given numbers."""

from dataclasses import replace

import numpy as np
import pytest

from idim_iv_ros.gap.baseline import Baseline, baseline
from idim_iv_ros.gap.likelihood import Regression
from idim_iv_ros.gap.missing_gravity import missing_gravity
from idim_iv_ros.gap.parametric import ParametricOutcome, parametric_causes
from idim_iv_ros.gap.regression_rows import smooth_regression
from tests.estimation.test_simulated_arms import recorded
from tests.simulated_arms import arm2

NOISE = (0.15, 0.05)  # N m, of a row


@pytest.fixture(scope="module")
def data() -> Baseline:
    arm = arm2(seconds=24.0)
    return baseline([recorded(arm, 1)], arm.configuration)


def world(data: Baseline, values: np.ndarray, seed: int = 1) -> Regression:
    """Rows of the refit whose torque is that of base parameters (b,), with noise."""
    random = np.random.default_rng(seed)
    plain = smooth_regression(data)
    made = [
        replace(
            rows,
            torque=rows.matrix @ values[rows.columns]
            + NOISE[joint] * random.standard_normal(len(rows.torque)),
        )
        for joint, rows in enumerate(plain.joints)
    ]
    return Regression(tuple(made), plain.parameters)


def outcome(data: Baseline, values: np.ndarray, seed: int = 1) -> ParametricOutcome:
    regression = world(data, values, seed)
    return parametric_causes(data, regression, regression.fit())


def given(data: Baseline) -> np.ndarray:
    values = data.prepared.given
    assert values is not None
    return values


def test_right_numbers_are_not_accused(data: Baseline) -> None:
    for seed in range(5):
        assert outcome(data, given(data), seed).causes == ()


def test_friction_that_grew_is_named_with_its_joint_and_size(data: Baseline) -> None:
    names = data.prepared.model.base.names
    values = given(data).copy()
    values[names.index("Fc2")] += 0.6
    (cause,) = outcome(data, values).causes
    assert (cause.effect.name, cause.joint) == ("friction_level", "joint_2")
    change = cause.parameters["change_of_coulomb"]
    assert change.std is not None
    assert abs(change.value - 0.6) < 4.0 * change.std
    assert cause.share > 0.9
    assert cause.p_value < 1e-6


def test_a_load_in_the_hand_is_a_payload(data: Baseline) -> None:
    model = data.prepared.model
    mass, place = 0.5, np.array([0.3, 0.0, 0.02])
    inertial = model.robot.given.inertial.copy()
    tensor = mass * (place @ place * np.eye(3) - np.outer(place, place))
    # XX XY XZ YY YZ ZZ and MX MY MZ M are told apart by what the layout makes of them.
    layout = model.regressor.layout
    standard = layout.vector(model.robot.given)
    added = {
        "M": mass, "MX": mass * place[0], "MY": mass * place[1], "MZ": mass * place[2],
        "XX": tensor[0, 0], "XY": tensor[0, 1], "XZ": tensor[0, 2],
        "YY": tensor[1, 1], "YZ": tensor[1, 2], "ZZ": tensor[2, 2],
    }  # fmt: skip
    last = len(inertial) - 1
    for number, parameter in enumerate(layout.parameters):
        if parameter.joint == last and parameter.kind in added:
            standard[number] += added[parameter.kind]
    found = outcome(data, model.base.from_standard(standard)).causes
    assert found
    assert found[0].effect.name == "payload"
    assert len(found) == 1


def test_gravity_that_is_there_is_not_missed(data: Baseline) -> None:
    assert missing_gravity(data, world(data, given(data))) is None
