"""Every effect of the catalogue: its torque by a formula of its own, its shapes, names, signs."""

import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from numba import njit
from scipy.integrate import solve_ivp

from bags.simulated_arms import arm2
from idim_iv_ros import effects
from idim_iv_ros.diagnosis.refit.smooth_motion import SmoothMotion
from idim_iv_ros.effects import registry
from idim_iv_ros.effects.backlash import BacklashShape
from idim_iv_ros.effects.cause import Cause, GivenNumbers
from idim_iv_ros.effects.contribution import STATES, CouplingTerm, Instant, Load, Torque, TorqueTerm
from idim_iv_ros.effects.effect import Effect, JointRange, Place, Shape
from idim_iv_ros.effects.elasticity import ShaftShape
from idim_iv_ros.effects.encoder_eccentricity import DiscShape
from idim_iv_ros.effects.friction_drift import DriftShape
from idim_iv_ros.effects.joint_coupling import CouplingShape
from idim_iv_ros.effects.load_dependent_friction import LoadShape
from idim_iv_ros.effects.nonlinear_viscous import PowerShape
from idim_iv_ros.effects.parametric_effect import Change, Estimated, ParameterSpace
from idim_iv_ros.effects.payload import Payload
from idim_iv_ros.effects.position_dependent_friction import TightSpot
from idim_iv_ros.effects.presliding import BristleShape
from idim_iv_ros.effects.registry import CAUSES, EFFECTS, PARAMETRIC, STRUCTURAL
from idim_iv_ros.effects.spring import BentShape, CubicShape, LineShape
from idim_iv_ros.effects.stribeck import StribeckShape
from idim_iv_ros.effects.time_delay import DelayShape
from idim_iv_ros.effects.torque_saturation import KneeShape
from idim_iv_ros.effects.waves import Waves
from idim_iv_ros.model import build_inverse_model
from tests.diagnosis.motions import added_by, gravity_and_coriolis, synthetic, without_jumps

BY_NAME: dict[str, Effect] = {effect.name: effect for effect in STRUCTURAL}
BOTH_WAYS = LoadShape(1.0, 5.0, True, Load.LINKS)
FloatArray = np.ndarray


def joint_range_of(motion: SmoothMotion, joint: int) -> JointRange:
    position, velocity = motion.position[:, joint], motion.velocity[:, joint]
    return JointRange(
        low=float(position.min()),
        high=float(position.max()),
        slowest=0.02,
        fastest=float(np.abs(velocity).max()),
        mean_speed=float(np.abs(velocity).mean()),
        load=float(np.abs(motion.load[:, joint]).max()),
        torque=float(np.abs(motion.torque[:, joint]).max()),
        dry_friction=1.0,
        inertia=float(np.mean(motion.inertia[:, joint, joint])),
        lever=1.0,
        duration=float(motion.time[-1]),
        longest=float(motion.elapsed[-1]),
        row_rate=50.0,
        sticking=True,
        left_out=False,
    )


def total(
    motion: SmoothMotion, name: str, shape: Shape, values: list[float]
) -> dict[int, FloatArray]:
    place = Place(0, 1) if name == "joint_coupling" else Place(1)
    columns = BY_NAME[name].columns(motion, place, shape)
    return {j: rows @ np.asarray(values) for j, rows in columns.items()}


Formula = Callable[[SmoothMotion, FloatArray, FloatArray], FloatArray]
# Name, shape, coefficients, torque at joint 2 from motion, position and velocity.
FORMULAS: list[tuple[str, Shape, list[float], Formula]] = [
    ("stribeck", StribeckShape(0.2, 1.5), [0.7],
     lambda m, q, v: 0.7 * np.sign(v) / np.exp((abs(v) / 0.2) ** 1.5)),
    ("nonlinear_viscous", PowerShape(0.6), [1.3], lambda m, q, v: 1.3 * v / abs(v) ** 0.4),
    ("asymmetric_friction", Shape(), [0.2], lambda m, q, v: np.where(v > 0, 0.2 * v, -0.2 * v)),
    ("load_dependent_friction", LoadShape(1.0, 5.0, False, Load.LINKS), [0.1],
     lambda m, q, v: 0.1 * abs(m.load[:, 1]) * np.sign(v)),
    ("load_dependent_friction", LoadShape(1.3, 5.0, True, Load.LINKS), [0.1, 0.2],
     lambda m, q, v: np.where(m.load[:, 1] * v > 0, 0.1, 0.2) * np.sign(v)
     * 5.0 * (abs(m.load[:, 1]) / 5.0) ** 1.3),
    ("load_dependent_friction", LoadShape(0.8, 5.0, True, Load.MOTOR), [0.1, 0.2],
     lambda m, q, v: np.where(m.torque[:, 1] * v > 0, 0.1, 0.2) * np.sign(v)
     * 5.0 * (abs(m.torque[:, 1]) / 5.0) ** 0.8),
    ("load_dependent_friction", LoadShape(1.3, 5.0, True, Load.STATIC), [0.1, 0.2],
     lambda m, q, v: np.where(gravity_and_coriolis(m, 1) * v > 0, 0.1, 0.2) * np.sign(v)
     * 5.0 * (abs(gravity_and_coriolis(m, 1)) / 5.0) ** 1.3),
    ("position_dependent_friction", Waves((7.0,)), [0.3, 0.4],
     lambda m, q, v: np.sign(v) * 0.5 * np.cos(7.0 * q - np.arctan2(0.3, 0.4))),
    ("position_dependent_friction", TightSpot(0.2, 0.1), [0.6],
     lambda m, q, v: np.sign(v) * 0.6 * np.exp(-100.0 * (q - 0.2) ** 2)),
    ("friction_drift", DriftShape(30.0, False), [0.5, 0.2],
     lambda m, q, v: (0.5 * np.sign(v) + 0.2 * v) * np.exp(-m.time / 30.0)),
    ("friction_drift", DriftShape(30.0, True), [0.5, 0.2],
     lambda m, q, v: (0.5 * np.sign(v) + 0.2 * v) * np.exp(-(m.time - 40.0) / 30.0)),
    ("torque_saturation", KneeShape(3.0), [0.4],
     lambda m, q, v: 0.4 * (m.torque[:, 1] - np.clip(m.torque[:, 1], -3.0, 3.0))),
    ("position_ripple", Waves((9.0, 31.0)), [0.1, 0.2, 0.3, -0.4],
     lambda m, q, v: 0.1 * np.sin(9 * q) + 0.2 * np.cos(9 * q)
     + 0.3 * np.sin(31 * q) - 0.4 * np.cos(31 * q)),
    ("spring", CubicShape(-0.2, 0.6), [2.0, -3.0, 4.0],
     lambda m, q, v: np.polyval([4.0, -3.0, 2.0, 0.0], np.minimum(np.maximum(q, -0.2), 0.6))),
    ("spring", LineShape(-0.2, 0.6), [0.5, 2.0],
     lambda m, q, v: 0.5 + 2.0 * np.minimum(np.maximum(q, -0.2), 0.6)),
    ("spring", BentShape(True, -2.0, 2.0, 0.1, 0.3), [2.0, 0.5],
     lambda m, q, v: 2.0 * q + 0.25 * (np.exp((q - 0.1) / 0.3) - np.exp((0.1 - q) / 0.3))),
    ("spring", BentShape(False, -2.0, 2.0, 0.1, 0.3), [2.0, 0.5],
     lambda m, q, v: 2.0 * q + 0.5 * np.arctan2(q - 0.1, 0.3)),
]  # fmt: skip


@pytest.mark.parametrize(("name", "shape", "values", "formula"), FORMULAS)
def test_torque_is_that_of_the_formula(name, shape, values, formula) -> None:
    motion = synthetic()
    motion = replace(motion, start=40.0, time=40.0 + motion.time)
    torques = total(motion, name, shape, values)
    assert list(torques) == [1]
    expected = formula(motion, motion.position[:, 1], motion.velocity[:, 1])
    np.testing.assert_allclose(torques[1], expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("restarts", [True, False])
def test_motion_warms_a_joint_as_a_heat_balance_says(restarts: bool) -> None:
    """SciPy's integration of the balance, from the warmth that time alone makes until the start."""
    motion = synthetic()
    motion = replace(motion, start=40.0, time=40.0 + motion.time)
    v, tau, speed = motion.velocity[:, 1], 3.0, 0.5
    torque = total(motion, "friction_drift", DriftShape(tau, restarts, speed), [0.5, 0.2])[1]
    balance = solve_ivp(
        lambda t, w: (np.interp(t, motion.time, abs(v)) / speed - w) / tau,
        motion.time[[0, -1]],
        [0.0 if restarts else 1.0 - np.exp(-40.0 / tau)],
        t_eval=motion.time,
        max_step=0.01,
    )
    friction = 0.5 * np.sign(v) + 0.2 * v
    within = abs(friction).max() * abs(v).max() / (speed * tau * motion.rate)  # of one sample
    np.testing.assert_allclose(torque, (1.0 - balance.y[0]) * friction, atol=within)
    assert np.ptp(balance.y[0]) > 20.0 * within


def test_bristles_carry_less_until_they_slip() -> None:
    """After a reversal a bristle of span s has −1 + |Δq| / s, as long as that is below 1."""
    motion = synthetic()
    span, level = 0.05, 0.8
    torques = total(motion, "presliding", BristleShape((span,)), [level])[1]
    q, v = motion.position[:, 1], motion.velocity[:, 1]
    turns = np.flatnonzero(np.diff(np.sign(v))) + 1
    checked = 0
    for before, first, last in zip(turns[:-2], turns[1:-1], turns[2:], strict=True):
        if abs(q[first] - q[before]) < 2.1 * span:  # it had not slipped the other way
            continue
        moved = abs(q[first : last - 1] - q[first])
        sign = np.sign(v[first])
        expected = level * sign * (np.minimum(-1.0 + moved / span, 1.0) - 1.0)
        np.testing.assert_allclose(torques[first : last - 1], expected, atol=level * 2e-3 / span)
        checked += 1
    assert checked >= 3


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_coupled_joints_share_the_friction_of_their_common_part(sign: float) -> None:
    """Its power is never negative, and it acts on both with its lever arms 1 and ±1."""
    motion = synthetic()
    torques = total(motion, "joint_coupling", CouplingShape(sign, 1.3), [0.3, 0.2])
    w = motion.velocity @ np.array([1.0, sign])
    power = torques[0] * motion.velocity[:, 0] + torques[1] * motion.velocity[:, 1]
    np.testing.assert_allclose(power, 0.3 * abs(w) + 0.2 * abs(w) ** 2.3, atol=1e-12)
    np.testing.assert_allclose(torques[1], sign * torques[0])


def test_a_late_torque_is_the_torque_of_later() -> None:
    motion = without_jumps(synthetic())
    delay = 0.006
    torques = total(motion, "time_delay", DelayShape(delay), [1.0])[1]
    torque = motion.torque[:, 1]
    expected = np.interp(motion.time + delay, motion.time, torque) - torque
    inner = slice(10, -10)
    assert np.abs(torques - expected)[inner].max() < 5e-3 * np.abs(expected).max()


def test_a_disc_off_its_centre_moves_the_torques_of_a_wrong_motion() -> None:
    """The robot stands at q − e(q) where the encoder says q."""
    motion = synthetic()
    size = 1e-3
    torques = total(motion, "encoder_eccentricity", DiscShape(True), [0.0, 0.0, size, 0.0])
    angle, speed, change = (
        x[:, 1] for x in (motion.position, motion.velocity, motion.acceleration)
    )
    sine, cosine = np.sin(2 * angle), np.cos(2 * angle)
    error = sine, 2 * speed * cosine, 2 * change * cosine - 4 * speed**2 * sine
    expected = added_by(motion, motion.whole, *(-size * wave for wave in error))
    # Not where the friction changes its sign.
    calm = np.abs(motion.velocity[:, 1]) > 0.02
    calm[:3] = calm[-3:] = False
    for joint in (0, 1):
        largest = np.abs(expected[:, joint]).max()
        assert np.abs(torques[joint] - expected[:, joint])[calm].max() < 0.02 * largest


def test_a_wrong_zero_turns_what_is_behind_the_joint() -> None:
    motion = synthetic()
    torques = total(motion, "encoder_offset", Shape(), [2e-3])
    expected = added_by(motion, motion.whole, -2e-3, 0.0, 0.0)
    for joint in (0, 1):
        largest = np.abs(expected[:, joint]).max()
        assert np.abs(torques[joint] - expected[:, joint]).max() < 0.01 * largest


@pytest.mark.parametrize("effect", STRUCTURAL, ids=lambda effect: effect.name)
def test_shapes_of_a_moving_joint_give_finite_torques_of_one_width(effect: Effect) -> None:
    motion = synthetic(3.0)
    for place in effect.places(2):
        covered = joint_range_of(motion, place.joint)
        grid = effect.grid(covered)
        assert 0 < len(grid) <= 700
        assert len(set(grid)) == len(grid)
        parts = [shape for part in effect.branches(grid) for shape in part]
        assert len(parts) == len(grid) and set(parts) == set(grid)
        for shape in grid[:: max(1, len(grid) // 8)]:
            columns = effect.columns(motion, place, shape)
            widths = {rows.shape for rows in columns.values()}
            assert len(widths) == 1
            assert all(np.isfinite(rows).all() for rows in columns.values())
            width = widths.pop()[1]
            numbers = effect.parameters(shape, np.full(width, 0.7), np.full(width, 0.1))
            assert all(np.isfinite(parameter.value) for parameter in numbers.values())
            for step in (0.3, 0.07):
                for near in effect.neighbours(shape, step, covered):
                    assert type(near) is type(shape)
                    assert len(near.numbers) == len(shape.numbers)
                    assert np.isfinite(near.numbers).all()


@pytest.mark.parametrize("effect", STRUCTURAL, ids=lambda effect: effect.name)
@pytest.mark.filterwarnings("error")
def test_a_joint_that_stands_still_does_no_harm(effect: Effect) -> None:
    """No shape, or finite torques (columns of zeros count for nothing, see the likelihood)."""
    motion = synthetic(2.0, still=1)
    place = effect.places(2)[-1]
    for shape in effect.grid(joint_range_of(motion, place.joint)):
        columns = effect.columns(motion, place, shape)
        assert all(np.isfinite(rows).all() for rows in columns.values())


UNITS = {
    "stribeck": {"excess": "N m", "speed": "rad/s", "exponent": ""},
    "nonlinear_viscous": {"coefficient": "N m at 1 rad/s", "power": ""},
    "asymmetric_friction": {"viscous": "N m s/rad"},
    "load_dependent_friction": {
        "driving": "", "driven": "", "exponent": "", "scale": "N m", "motor_torque": "",
        "static_torque": "",
    },
    "position_dependent_friction": {"wave_number_1": "1/rad", "sine_1": "N m", "cosine_1": "N m"},
    "friction_drift": {
        "time_constant": "s", "coulomb": "N m", "viscous": "N m s/rad", "restarts": "",
        "speed": "rad/s", "nominal": "",
    },
    "presliding": {"span_1": "rad", "level_1": "N m"},
    "backlash": {"gap": "rad", "stiffness": "N m/rad", "damping": "N m s/rad"},
    "elasticity": {"stiffness": "N m/rad", "damping": "N m s/rad"},
    "time_delay": {"delay": "s"},
    "torque_saturation": {"knee": "N m", "slope": ""},
    "position_ripple": {"wave_number_1": "1/rad", "sine_1": "N m", "cosine_1": "N m"},
    "spring": {
        "linear": "N m/rad", "quadratic": "N m/rad²", "cubic": "N m/rad³",
        "lowest": "rad", "highest": "rad",
    },
    "encoder_offset": {"offset": "rad"},
    "encoder_eccentricity": dict.fromkeys(("sine", "cosine", "sine_2", "cosine_2"), "rad"),
    "joint_coupling": {"direction": "", "coulomb": "N m", "viscous": "N m at 1 rad/s", "power": ""},
}  # fmt: skip
# Of the parameters above; the first shape of the grid elsewhere.
SHAPES = {"encoder_eccentricity": DiscShape(True), "spring": CubicShape(-0.2, 0.6)}


@pytest.mark.parametrize("effect", STRUCTURAL, ids=lambda effect: effect.name)
def test_parameters_have_their_names_and_units(effect: Effect) -> None:
    motion = synthetic(2.0)
    place = effect.places(2)[0]
    shape = SHAPES.get(effect.name) or effect.grid(joint_range_of(motion, place.joint))[0]
    width = effect.columns(motion, place, shape)[place.joint].shape[1]
    numbers = effect.parameters(shape, np.full(width, 0.5), np.full(width, 0.1))
    units = {name: parameter.unit for name, parameter in numbers.items()}
    if effect.name in UNITS:
        assert units == UNITS[effect.name]
    # A new effect may have other names, in the units of the field.
    assert set(units.values()) <= {unit for named in UNITS.values() for unit in named.values()}
    assert any(parameter.std for parameter in numbers.values())


def test_a_joint_that_slides_has_screws_plays_and_bristles_of_its_own_size() -> None:
    turning = replace(joint_range_of(synthetic(), 1), low=-0.1, high=0.1)
    sliding = replace(turning, slowest=0.002, lever=0.1)
    pitch = 0.01  # m, of a ball screw
    ripple = [shape.wave_numbers[0] for shape in BY_NAME["position_ripple"].grid(sliding)]
    assert min(ripple) < 2.0 * np.pi / pitch < max(ripple)
    finest = BY_NAME["position_ripple"].grid(turning)[-1]
    assert finest.wave_numbers[0] <= 250.0
    gaps = [shape.gap for shape in BY_NAME["backlash"].grid(sliding)]
    assert max(gaps) == pytest.approx(0.004)
    slow = replace(sliding, fastest=1e-4)
    spans = [shape.spans[0] for shape in BY_NAME["presliding"].grid(slow)]
    assert min(spans) == pytest.approx(1e-5)  # of a joint that turns slowly
    play = BY_NAME["backlash"]
    for gap, common in ((0.9e-4, True), (0.5e-3, False)):  # m
        shape = BacklashShape(gap, 1e5, 10.0, 1.0)
        assert play.plausible(shape, np.ones(1), 1.0, sliding) == common


@pytest.mark.parametrize(
    ("name", "shape", "common", "large"),
    [
        ("load_dependent_friction", BOTH_WAYS, [0.05, 0.09], [0.05, 0.11]),
        ("time_delay", DelayShape(0.002), [0.9], [1.1]),
        ("encoder_eccentricity", DiscShape(False), [0.001, -0.0019], [0.001, -0.0021]),
        ("elasticity", ShaftShape(0.1 * (2 * np.pi * 11.0) ** 2, 1.0), [0.9], [1.1]),
    ],
)
def test_sizes_that_are_no_torque_have_a_bound_of_their_own(name, shape, common, large) -> None:
    """Of a joint with 0.1 kg m²; no torque is too large."""
    effect = BY_NAME[name]
    covered = replace(joint_range_of(synthetic(), 1), inertia=0.1)
    assert effect.plausible(shape, np.array(common), 1e3, covered)
    assert not effect.plausible(shape, np.array(large), 0.0, covered)


@pytest.mark.parametrize(
    ("name", "poor", "reason"),
    [
        ("stribeck", {"fastest": 0.2}, "too slow"),
        ("nonlinear_viscous", {"fastest": 0.2}, "too slow"),
        ("encoder_eccentricity", {"high": 0.4}, "looks constant"),
        ("encoder_eccentricity", {"lever": 0.1}, "looks constant"),
    ],
)
def test_motion_that_cannot_show_an_effect(name, poor, reason) -> None:
    rich = replace(joint_range_of(synthetic(), 1), fastest=2.0, low=0.0, high=1.0, duration=60.0)
    for effect in STRUCTURAL:
        assert effect.cannot_show(rich) == ""
    assert reason in BY_NAME[name].cannot_show(replace(rich, **poor))


IN_ORDER = (
    "payload", "gravity_direction", "torque_gain", "torque_offset", "friction_level",
    "drive_inertia", "link_inertia",
    "stribeck", "nonlinear_viscous", "asymmetric_friction", "load_dependent_friction",
    "position_dependent_friction", "friction_drift", "presliding", "backlash", "elasticity",
    "time_delay", "torque_saturation", "position_ripple", "spring", "encoder_offset",
    "encoder_eccentricity", "joint_coupling",
)  # fmt: skip


def test_the_catalogue_has_every_file_in_the_order_that_they_give() -> None:
    """Where two explain equally well the first counts: the order is a part of the result."""
    names = [effect.name for effect in (*PARAMETRIC, *STRUCTURAL)]
    assert [name for name in names if name in IN_ORDER] == list(IN_ORDER)
    assert sorted([*names, "controller_mismatch"]) == sorted(set(EFFECTS))
    for kind in (PARAMETRIC, STRUCTURAL):
        assert len({effect.order for effect in kind}) == len(kind)
        for effect in kind:
            assert type(effect).__module__ == f"idim_iv_ros.effects.{effect.name}"


def default_numbers(cause: Cause) -> GivenNumbers:
    """Every parameter as it stands where nothing is given, 1 where it must be given."""
    values = {spec.name: 1.0 if spec.default is None else spec.default for spec in cause.specs}
    terms = [{name: value for name, value in values.items() if name.endswith("_k")}]
    alone = {name: value for name, value in values.items() if not name.endswith("_k")}
    return GivenNumbers(alone, terms if terms[0] else (), coulomb=2.0)


@pytest.mark.parametrize("cause", CAUSES, ids=lambda cause: cause.name)
def test_what_is_simulated_uses_the_laws_that_the_file_declares(cause: Cause) -> None:
    contributions = list(cause.contributions(default_numbers(cause)))
    assert bool(contributions) != cause.in_base_parameters
    for contribution in contributions:
        law = getattr(contribution, "law", None)
        assert law is None or law in cause.laws
        if isinstance(contribution, (TorqueTerm, CouplingTerm)):
            at = Instant(2.0, 1.0, 0.3, 0.5, 1.0, 2.0, 0.5, 1e-3)
            # From Python, as the laws themselves cannot be called.
            called = njit(contribution.law.torque.py_func)
            torque = called(np.array(contribution.values), at, np.zeros(STATES))
            assert len(torque) == len(Torque._fields) and np.isfinite(torque).all()


@pytest.mark.parametrize(
    ("name", "shape", "good", "bad"),
    [
        ("stribeck", StribeckShape(0.1, 1.0), [0.3], [-0.3]),
        ("nonlinear_viscous", PowerShape(2.0), [0.3], [-0.3]),
        ("load_dependent_friction", BOTH_WAYS, [0.1, 0.2], [0.1, -0.2]),
        ("presliding", BristleShape((0.01, 0.1)), [0.1, 0.2], [0.1, -0.2]),
        ("backlash", BacklashShape(0.01, 1e3, 1.0, 1.0), [1.0], [-1.0]),
        ("elasticity", ShaftShape(1e3, 1.0), [1.0], [-1.0]),
        ("time_delay", DelayShape(0.002), [1.0], [-1.0]),
        ("torque_saturation", KneeShape(3.0), [0.2], [-0.2]),
        ("encoder_offset", Shape(), [-0.02], [0.3]),
        ("encoder_eccentricity", DiscShape(False), [0.01, -0.01], [0.2, 0.0]),
        ("joint_coupling", CouplingShape(1.0, 1.0), [0.2, 0.1], [-0.2, 0.1]),
        # Of either sign.
        ("asymmetric_friction", Shape(), [-0.3], None),
        ("friction_drift", DriftShape(30.0, False), [-0.3, -0.3], None),
        ("spring", CubicShape(-0.2, 0.6), [-0.3, 0.3, -0.3], None),
        ("position_ripple", Waves((9.0,)), [-0.3, 0.3], None),
    ],
)
def test_physics_forbids_signs_and_sizes(name, shape, good, bad) -> None:
    effect = BY_NAME[name]
    assert effect.admissible(shape, np.array(good))
    other = -np.array(good) if bad is None else np.array(bad)
    assert effect.admissible(shape, other) == (bad is None)


@pytest.mark.parametrize(
    ("effect", "shape", "coefficient", "name", "value", "std"),
    [
        # Command τ + 0.25 (τ − knee): 1 / 1.25.
        ("torque_saturation", KneeShape(3.0), 0.25, "slope", 0.8, 0.05 / 1.25**2),
        ("elasticity", ShaftShape(500.0, 2.0), 1.25, "stiffness", 400.0, 400.0 * 0.05 / 1.25),
        ("time_delay", DelayShape(0.004), 1.5, "delay", 0.006, 0.0002),
        ("backlash", BacklashShape(0.01, 1e3, 3.0, 1.0), 1.0, "gap", 0.01, 0.0005),
    ],
)
def test_numbers_of_an_engineer(effect, shape, coefficient, name, value, std) -> None:
    """Slope beyond the knee, stiffness and delay from coefficients, with their deviations."""
    numbers = BY_NAME[effect].parameters(shape, np.array([coefficient]), np.array([0.05]))
    assert (numbers[name].value, numbers[name].std) == (pytest.approx(value), pytest.approx(std))


_INERTIA = ("xx", "xy", "yy", "xz", "yz", "zz")  # as pinocchio has them
POINT = ("mass", "moment_x", "moment_y", "moment_z")


@pytest.fixture(scope="module")
def space() -> ParameterSpace:
    configuration = arm2(seconds=2.0).configuration
    urdf = configuration.robot.urdf
    assert urdf is not None
    model = build_inverse_model(configuration, urdf.read_text(encoding="utf-8"), urdf.name)
    return ParameterSpace(model, model.given, np.eye(3)[:2])


def body(mass: float, centre: tuple[float, float, float]) -> dict[str, float]:
    """The ten numbers of a box of 0.1 × 0.2 × 0.3 m about the link's frame, by pinocchio."""
    box = pin.Inertia.FromBox(mass, 0.1, 0.2, 0.3)
    moved = pin.Inertia(mass, np.array(centre), box.inertia)
    names = (*POINT, *(f"inertia_{name}" for name in _INERTIA))
    return dict(zip(names, moved.toDynamicParameters().tolist(), strict=True))


def allowed(space: ParameterSpace, numbers: Mapping[str, float], std: float = 1e-4) -> bool:
    none = np.zeros(space.size)
    estimates = [Estimated(Change(name, "", none), size, std) for name, size in numbers.items()]
    return Payload().admissible(space, space.joints - 1, estimates)


@pytest.mark.parametrize("centre", [(0.0, 0.0, 0.0), (0.1, -0.05, 0.2), (0.3, 0.0, 0.0)])
def test_bodies_are_allowed(space: ParameterSpace, centre: tuple[float, float, float]) -> None:
    assert allowed(space, body(1.5, centre))


def test_a_centre_beyond_the_size_of_the_arm_is_none(space: ParameterSpace) -> None:
    far = body(0.5, (20.0, 0.0, 0.0))
    assert not allowed(space, far)
    point = {name: far[name] for name in POINT}
    assert not allowed(space, point)
    assert allowed(space, point, std=4.0)  # it may be near: so wide is the interval


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("inertia_xx", 1.0),  # more than the other two together
        ("inertia_xy", 0.5),  # more than its products allow
        ("moment_x", 0.8),  # the inertia about the frame is too small for it
    ],
)
def test_numbers_that_no_body_has_are_none(space: ParameterSpace, name: str, value: float) -> None:
    numbers = body(1.5, (0.05, 0.0, 0.1)) | {name: value}
    assert not allowed(space, numbers)
    assert allowed(space, numbers, std=1.0)


def test_a_part_that_is_not_there_is_a_body_with_the_other_sign(space: ParameterSpace) -> None:
    assert space.model.robot.given.inertial[space.joints - 1, 0] > 0.2
    part = {name: -value for name, value in body(0.2, (0.05, 0.0, 0.02)).items()}
    point = {name: part[name] for name in POINT}
    assert allowed(space, point)
    assert not allowed(space, point | {"moment_x": 5.0})


def test_an_effect_is_added_by_its_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (Path(effects.__path__[0]) / "spring.py").read_text()
    text = text.replace('name = "spring"', 'name = "rope"').replace("order = 130", "order = 5")
    (tmp_path / "rope.py").write_text(text)
    monkeypatch.setattr(effects, "__path__", [*effects.__path__, str(tmp_path)])
    names = [cause.name for cause in registry.catalogue()[1]]
    assert names.index("rope") == names.index("stribeck") - 1
    del sys.modules["idim_iv_ros.effects.rope"]
