"""Torques of the effects, by formulas written here: model + effect = what acts on the joint."""

import numpy as np
import pytest

from bags.simulated_arms import arm2
from idim_iv_ros.errors import UsageError
from idim_iv_ros.simulation import SimulatedEffect, inverse_dynamics
from tests.simulation.laws import followed

JOINTS = ("joint_1", "joint_2")


@pytest.fixture(scope="module")
def arm():
    return arm2(seconds=3.0)


def on(joint, effect, other=None, **parameters):
    return SimulatedEffect(effect, JOINTS[joint], parameters, None if other is None else other)


def surplus(arm, result, parameters=None):
    """Torque on the joints that the model does not explain, and which samples move."""
    needed = inverse_dynamics(
        arm.robot, parameters or arm.truth, result.position, result.velocity, result.acceleration
    )
    moving = np.all(result.velocity != 0.0, axis=1)
    assert moving.sum() > 2000
    return (result.applied_torque - needed)[moving], moving


# Constant parts and the time since the session began. The other laws: those of the catalogue
# (test_catalogue.py), which stand as formulas in tests/diagnosis/test_effects.py.
FORMULAS = {
    "asymmetric_friction": (
        {"offset": 0.6, "viscous": -0.3},
        lambda q, v, t: 0.6 - 0.3 * np.abs(v),
    ),
    "friction_drift": (
        {"time_constant": 2.0, "coulomb": 0.8, "viscous": 0.5},
        lambda q, v, t: np.exp(-(t + 1.5) / 2.0) * (0.8 * np.sign(v) + 0.5 * v),
    ),
    "friction_drift anew": (
        {"time_constant": 2.0, "coulomb": 0.8, "viscous": 0.5, "restarts": 1.0},
        lambda q, v, t: np.exp(-t / 2.0) * (0.8 * np.sign(v) + 0.5 * v),
    ),
    "spring": (
        {"constant": 0.5, "linear": 2.0, "quadratic": -0.4, "cubic": 1.0, "highest": 0.5},
        lambda q, v, t: np.polyval([1.0, -0.4, 2.0, 0.5], np.minimum(q, 0.5)),
    ),
}


@pytest.mark.parametrize("name", FORMULAS)
def test_acting_torque_is_the_model_plus_the_formula(arm, name):
    parameters, formula = FORMULAS[name]
    joint = list(FORMULAS).index(name) % 2
    result = followed(arm, on(joint, name.split()[0], **parameters), start_time=1.5)
    extra, moving = surplus(arm, result)
    time = np.arange(len(result.position)) / arm.rate
    q, v = result.position[moving, joint], result.velocity[moving, joint]
    expected = np.zeros_like(extra)
    expected[:, joint] = formula(q, v, time[moving])
    assert np.ptp(expected[:, joint]) > 0.1
    np.testing.assert_allclose(extra, expected, atol=1e-9)


@pytest.mark.parametrize(
    ("direction", "coulomb", "viscous", "power"),
    [
        (1.0, 0.9, 0.2, 1.0), (-1.0, 0.3, 0.4, 0.5), (-1.0, 0.2, 0.3, 1.6), (-1.0, -0.2, 0.5, 1.3),
        (-1.0, 0.6, -0.2, 0.8),
    ],
)  # fmt: skip
def test_coupling_resists_with_the_sum_of_its_parts(arm, direction, coulomb, viscous, power):
    """At both joints; a part with the other sign is taken from it: the sum is kept from driving."""
    parts = {"direction": direction, "coulomb": coulomb, "viscous": viscous, "power": power}
    result = followed(arm, on(0, "joint_coupling", "joint_2", **parts))
    extra, moving = surplus(arm, result)
    w = result.velocity[moving, 0] + direction * result.velocity[moving, 1]
    f = np.maximum(coulomb + viscous * np.abs(w) ** power, 0.0) * np.sign(w)
    slipping = w != 0.0
    assert slipping.sum() > 2000
    expected = np.column_stack([f, direction * f])
    accuracy = 1e-9 if power == 1.0 else 1e-8
    np.testing.assert_allclose(extra[slipping], expected[slipping], atol=accuracy)


@pytest.mark.parametrize(
    ("effect", "joint", "other", "parameters", "words"),
    [
        ("warp", "joint_1", None, {}, ["warp", "stribeck"]),
        ("stribeck", "joint_1", None, {"speed": 0.1, "sped": 1.0}, ["stribeck", "sped"]),
        ("stribeck", "joint_1", None, {"excess": 0.1}, ["stribeck", "speed is missing"]),
        ("stribeck", "joint_1", None, {"speed": 0.0}, ["speed", "positive"]),
        ("stribeck", "joint_9", None, {"speed": 1.0}, ["joint_9", "joint_1"]),
        ("presliding", "joint_1", None, {"span_2": 1.0}, ["level_2 is missing"]),
        ("joint_coupling", "joint_1", None, {}, ["other_joint"]),
        ("joint_coupling", "joint_1", "joint_2", {"direction": 2.0}, ["direction", "1 or -1"]),
        ("spring", "joint_1", None, {"hardening": 2.0}, ["hardening", "0 or 1"]),
        ("spring", "joint_1", None, {"lowest": 1.0, "highest": 0.0}, ["lowest", "highest"]),
        ("load_dependent_friction", "joint_1", None, {"motor_torque": 0.5}, ["motor_torque", "0"]),
        ("load_dependent_friction", "joint_1", None, {"motor_torque": 1.0, "static_torque": 1.0},
         ["motor_torque", "static_torque"]),
        ("controller_mismatch", "joint_1", None, {"lag": -1e-3}, ["lag", "negative"]),
    ],
)  # fmt: skip
def test_what_cannot_be_simulated_is_named(arm, effect, joint, other, parameters, words):
    with pytest.raises(UsageError) as refused:
        followed(arm, SimulatedEffect(effect, joint, parameters, other))
    for word in words:
        assert word in str(refused.value)
