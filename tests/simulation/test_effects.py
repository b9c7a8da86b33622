"""Torques of the effects, by formulas written here: model + effect = what acts on the joint."""

import dataclasses

import numpy as np
import pytest

from bags.simulated_arms import arm2
from idim_iv_ros.errors import UsageError
from idim_iv_ros.simulation import SimulatedEffect, inverse_dynamics, mass_matrix
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


FORMULAS = {
    "stribeck": (
        {"excess": 1.2, "speed": 0.15, "exponent": 1.4},
        lambda q, v, t: 1.2 * np.exp(-((np.abs(v) / 0.15) ** 1.4)) * np.sign(v),
    ),
    "drag": (
        {"coefficient": 0.4, "power": 2.0},
        lambda q, v, t: 0.4 * v * np.abs(v),
    ),
    "drag that gets weaker": (
        {"coefficient": -0.05, "power": 3.0},
        lambda q, v, t: -0.05 * v**3,
    ),
    "drag below linear": (
        {"coefficient": 0.7, "power": 0.5},
        lambda q, v, t: 0.7 * np.sqrt(np.abs(v)) * np.sign(v),
    ),
    "asymmetric_friction": (
        {"offset": 0.6, "viscous": -0.3},
        lambda q, v, t: 0.6 - 0.3 * np.abs(v),
    ),
    "position_dependent_friction": (
        {
            "wave_number_1": 1.0, "sine_1": 0.2, "cosine_1": -0.1,
            "wave_number_2": 5.0, "sine_2": 0.1,
            "centre": 0.4, "width": 0.3, "height": 0.5,
        },
        lambda q, v, t: np.sign(v) * (
            0.2 * np.sin(q) - 0.1 * np.cos(q) + 0.1 * np.sin(5.0 * q)
            + 0.5 * np.exp(-(((q - 0.4) / 0.3) ** 2))
        ),
    ),
    "friction_drift": (
        {"time_constant": 2.0, "coulomb": 0.8, "viscous": 0.5},
        lambda q, v, t: np.exp(-(t + 1.5) / 2.0) * (0.8 * np.sign(v) + 0.5 * v),
    ),
    "friction_drift anew": (
        {"time_constant": 2.0, "coulomb": 0.8, "viscous": 0.5, "restarts": 1.0},
        lambda q, v, t: np.exp(-t / 2.0) * (0.8 * np.sign(v) + 0.5 * v),
    ),
    "position_ripple": (
        {
            "wave_number_1": 40.0, "sine_1": 0.5, "cosine_1": 0.2,
            "wave_number_2": 80.0, "sine_2": 0.1,
        },
        lambda q, v, t: 0.5 * np.sin(40 * q) + 0.2 * np.cos(40 * q) + 0.1 * np.sin(80 * q),
    ),
    "spring": (
        {"constant": 0.5, "linear": 2.0, "quadratic": -0.4, "cubic": 1.0, "highest": 0.5},
        lambda q, v, t: np.polyval([1.0, -0.4, 2.0, 0.5], np.minimum(q, 0.5)),
    ),
    "spring that hardens": (
        {
            "constant": 0.3, "linear": 1.0, "bent": 0.2, "centre": 0.4, "width": 0.25,
            "hardening": 1.0, "lowest": 0.0, "highest": 1.0,
        },
        lambda q, v, t: np.polyval([1.0, 0.3], np.clip(q, 0.0, 1.0))
        + 0.2 * np.sinh((np.clip(q, 0.0, 1.0) - 0.4) / 0.25),
    ),
    "spring that softens": (
        {"bent": -0.6, "centre": 0.3, "width": 0.1, "hardening": 0.0},
        lambda q, v, t: -0.6 * np.arctan((q - 0.3) / 0.1),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FORMULAS)
def test_acting_torque_is_the_model_plus_the_formula(arm, name):
    parameters, formula = FORMULAS[name]
    joint = list(FORMULAS).index(name) % 2
    effect = {"drag": "nonlinear_viscous"}.get(name.split()[0], name.split()[0])
    result = followed(arm, on(joint, effect, **parameters), start_time=1.5)
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


# The load is that of an instant before: wrong where it changes sign, small elsewhere.
LOADS = {
    "motor": (0, {"motor_torque": 1.0}, None),
    "links": (1, {}, None),
    "static": (1, {"static_torque": 1.0}, 1e-9),
}


def load_of(arm, result, kind):
    """Of the model: other effects are not in it, nor is the friction itself."""
    parameters = arm.truth if kind == "motor" else arm.truth.of_links
    torque = inverse_dynamics(
        arm.robot, parameters, result.position, result.velocity, result.acceleration
    )
    if kind == "static":
        inertia = mass_matrix(arm.robot, parameters, result.position)
        torque -= np.einsum("sij,sj->si", inertia, result.acceleration)
    return torque


@pytest.mark.parametrize("kind", LOADS)
def test_friction_follows_its_load(arm, kind):
    joint, chosen, tolerance = LOADS[kind]
    law = {"driving": 0.15, "driven": 0.05, "exponent": 0.8, "scale": 10.0, **chosen}
    spring = on(joint, "spring", constant=1.0)
    result = followed(arm, on(joint, "load_dependent_friction", **law), spring)
    extra, moving = surplus(arm, result)
    load, v = load_of(arm, result, kind)[moving, joint], result.velocity[moving, joint]
    friction = np.sign(v) * 10.0 * (np.abs(load) / 10.0) ** 0.8
    friction *= np.where(load * v > 0.0, 0.15, 0.05)
    assert np.ptp(friction) > 0.1
    error = extra[:, joint] - 1.0 - friction
    assert np.sqrt(np.mean(error**2)) < 0.01 * np.std(friction)
    assert tolerance is None or np.abs(error).max() < tolerance
    np.testing.assert_allclose(extra[:, 1 - joint], 0.0, atol=1e-9)


def test_bristles_are_maxwell_slip_elements_and_replace_part_of_coulomb_friction(arm):
    spans, levels = (2e-3, 1e-2), (0.3, 0.2)
    parameters = {
        "span_1": spans[0],
        "level_1": levels[0],
        "span_2": spans[1],
        "level_2": levels[1],
    }
    result = followed(arm, on(0, "presliding", **parameters))
    extra, moving = surplus(arm, result)
    q, v = result.position[:, 0], result.velocity[:, 0]
    expected = np.zeros(len(q))
    for span, level in zip(spans, levels, strict=True):
        z, path = 0.0, np.zeros(len(q))
        for k in range(1, len(q)):
            z = min(max(z + (q[k] - q[k - 1]) / span, -1.0), 1.0)
            path[k] = z
        expected += level * (path - np.sign(v))
    error = extra[:, 0] - expected[moving]
    assert np.sqrt(np.mean(error**2)) < 2e-3
    assert np.abs(expected[moving]).max() > 0.4


def test_bristles_take_no_more_than_the_coulomb_friction(arm):
    most = on(1, "presliding", span_1=1e-3, level_1=float(arm.truth.coulomb[1]))
    more = on(1, "presliding", span_1=1e-3, level_1=50.0)
    np.testing.assert_allclose(followed(arm, more).position, followed(arm, most).position)


def test_friction_that_only_the_sum_keeps_from_driving_is_simulated_whole(arm):
    """A refit may give Fv < 0 beside a drag that more than makes up for it."""
    viscous = np.array([-0.4, arm.truth.viscous[1]])
    parameters = dataclasses.replace(arm.truth, viscous=viscous)
    drag = on(0, "nonlinear_viscous", coefficient=3.0, power=1.0)
    result = followed(arm, drag, parameters=parameters)
    extra, moving = surplus(arm, result, parameters)
    np.testing.assert_allclose(extra[:, 0], 3.0 * result.velocity[moving, 0], atol=1e-9)


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
