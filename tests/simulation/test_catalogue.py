"""Simulator and diagnosis mean the same by each effect of the catalogue: names and torques."""

import dataclasses
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from bags.simulated_arms import arm2
from idim_iv_ros.effects.backlash import BacklashShape
from idim_iv_ros.effects.contribution import Load
from idim_iv_ros.effects.effect import Place, Shape
from idim_iv_ros.effects.elasticity import ShaftShape
from idim_iv_ros.effects.encoder_eccentricity import DiscShape
from idim_iv_ros.effects.friction_drift import DriftShape
from idim_iv_ros.effects.joint_coupling import CouplingShape
from idim_iv_ros.effects.load_dependent_friction import LoadShape
from idim_iv_ros.effects.nonlinear_viscous import PowerShape
from idim_iv_ros.effects.position_dependent_friction import TightSpot
from idim_iv_ros.effects.presliding import BristleShape
from idim_iv_ros.effects.registry import CAUSES, PARAMETRIC, STRUCTURAL
from idim_iv_ros.effects.spring import BentShape, CubicShape, LineShape
from idim_iv_ros.effects.stribeck import StribeckShape
from idim_iv_ros.effects.time_delay import DelayShape
from idim_iv_ros.effects.torque_saturation import KneeShape
from idim_iv_ros.effects.waves import Waves
from idim_iv_ros.simulation import SimulatedEffect, inverse_dynamics
from idim_iv_ros.simulation.effects import contributions_of
from tests.diagnosis.motions import smooth_motion
from tests.simulation.laws import followed

BY_NAME = {effect.name: effect for effect in STRUCTURAL}
JOINTS = ("joint_1", "joint_2")

# Constant parts of a law: the diagnosis has them as the base parameters' offsets.
CONSTANTS = {"asymmetric_friction": {"offset"}}


@cache
def arm():
    return arm2(seconds=3.0)


def smooth(position, velocity, acceleration, rate):
    return smooth_motion(arm(), position, velocity, acceleration, rate, factor=1)


def reported(effect, place, shape, coefficients):
    """What a gap.json would hold."""
    completed = effect.parameters(shape, np.asarray(coefficients), np.zeros(len(coefficients)))
    return {name: parameter.value for name, parameter in completed.items()}


def simulated(effect, place, parameters):
    other = None if place.other is None else JOINTS[place.other]
    return SimulatedEffect(effect.name, JOINTS[place.joint], parameters, other)


def test_each_effect_is_compared():
    """With a case below, or in a file of its own."""
    compared = {case.effect for case in CASES}
    compared |= {path.stem[5:] for path in Path(__file__).parent.glob("test_*.py")}
    assert compared >= set(BY_NAME)


@pytest.mark.parametrize("effect", PARAMETRIC, ids=lambda effect: effect.name)
def test_simulator_knows_the_parameters_that_may_be_in_error(effect):
    """As an effect, or as what the base parameters hold."""
    completed = contributions_of([SimulatedEffect(effect.name, None, {})], JOINTS)
    assert bool(completed.items) != effect.in_base_parameters


DOCUMENT = (Path(__file__).parents[2] / "docs" / "simulation.md").read_text()


@pytest.mark.parametrize("cause", CAUSES, ids=lambda cause: cause.name)
def test_documentation_has_the_parameters_of_what_is_simulated(cause):
    """Those that must be given are bold."""
    if cause.in_base_parameters:
        assert f"`{cause.name}`" in DOCUMENT
        return
    (cell,) = re.findall(rf"^\| `{cause.name}` \| (.*?) \| ", DOCUMENT, re.M)
    assert set(re.findall(r"\*\*(\w+)\*\*", cell)) == {
        spec.name for spec in cause.specs if spec.default is None
    }
    for spec in cause.specs:
        assert re.search(rf"\b{spec.name}\b", cell), spec.name


@dataclasses.dataclass(frozen=True)
class Case:
    """Shape and coefficients of one effect; rms of the difference as a share of the effect's."""

    effect: str
    shape: Shape
    coefficients: tuple[float, ...]
    tolerance: float = 1e-6
    joint: int = 0

    @property
    def place(self):
        return Place(0, 1) if self.effect == "joint_coupling" else Place(self.joint)


CASES = [
    Case("stribeck", StribeckShape(0.3, 1.4), (0.5,)),
    Case("nonlinear_viscous", PowerShape(0.5), (0.4,)),
    Case("nonlinear_viscous", PowerShape(2.0), (0.2,), joint=1),
    Case("asymmetric_friction", Shape(), (-0.2,)),
    # The load is that of the step before: late where the torque steps.
    Case("load_dependent_friction", LoadShape(0.8, 10.0, True, Load.LINKS), (0.08, 0.04), 2e-3),
    Case("load_dependent_friction", LoadShape(1.0, 10.0, False, Load.MOTOR), (0.08,), 2e-3),
    Case(
        "load_dependent_friction",
        LoadShape(0.6, 10.0, True, Load.MOTOR),
        (0.04, 0.08),
        5e-3,
        joint=1,
    ),
    Case("load_dependent_friction", LoadShape(1.3, 10.0, True, Load.STATIC), (0.08, 0.04)),
    Case("position_dependent_friction", Waves((3.0, 7.0)), (0.2, -0.1, 0.1, 0.1)),
    Case("position_dependent_friction", TightSpot(0.4, 0.2), (0.4,), joint=1),
    Case("friction_drift", DriftShape(2.0, False), (0.4, 0.3)),
    Case("friction_drift", DriftShape(2.0, True, 1.0), (0.4, 0.3), 1e-3, joint=1),
    # Between two samples a bristle may begin to slide.
    Case("presliding", BristleShape((2e-3, 1e-2)), (0.3, 0.2), 1e-3),
    # Two masses: the catalogue takes the inertia of the link's shift alone, not what the shift
    # changes of gravity (softer shafts differ more), and sees the motor between the samples as a
    # straight line, which lightly damped flanks amplify from one impact to the next.
    Case("backlash", BacklashShape(5e-4, 1e4, 10.0, 30.0), (1.0,), 0.2),
    Case("backlash", BacklashShape(2e-3, 1e3, 4.0, 8.0), (1.0,), 0.35, joint=1),
    Case("elasticity", ShaftShape(1e4, 8.0), (1.0,), 0.12),
    Case("elasticity", ShaftShape(2e3, 2.0), (1.0,), 0.12, joint=1),
    # The catalogue goes by the torque's derivatives, the simulation holds torques for a period.
    Case("time_delay", DelayShape(2e-3), (1.0,), 2e-3),
    # The mean of both sides of a step across the knee bends a little earlier.
    Case("torque_saturation", KneeShape(6.0), (0.3,), 1e-3),
    Case("position_ripple", Waves((40.0, 80.0)), (0.5, 0.2, 0.1, 0.0)),
    Case("spring", LineShape(-1.0, 0.5), (0.2, 1.0)),
    Case("spring", CubicShape(-1.0, 0.5), (1.0, -0.4, 0.5)),
    Case("spring", BentShape(True, 0.0, 1.0, 0.4, 0.3), (1.0, 0.2)),
    Case("spring", BentShape(False, 0.0, 1.0, 0.4, 0.2), (-1.0, 0.5), joint=1),
    Case("encoder_offset", Shape(), (3e-3,), 0.02),
    # First order in the error, and the acceleration that the encoder shows is a difference.
    Case("encoder_eccentricity", DiscShape(True), (3e-3, -2e-3, 1e-3, 5e-4), 0.02),
    Case("joint_coupling", CouplingShape(1.0, 1.0), (0.4, 0.2)),
    Case("joint_coupling", CouplingShape(-1.0, 0.6), (0.2, 0.4)),
    Case("joint_coupling", CouplingShape(-1.0, 1.5), (0.2, 0.4)),
]


def started_at_rest(one):
    """The law with the torque that holds the arm at its start: no fall that lets shafts ring."""
    still = np.zeros((1, 2))
    resting = inverse_dynamics(one.robot, one.truth, one.position_reference[:1], still, still)
    feedforward = np.repeat(resting, len(one.position_reference), axis=0)
    return dataclasses.replace(one.law, feedforward=feedforward)


def compare(case):
    one, effect = arm(), BY_NAME[case.effect]
    values = reported(effect, case.place, case.shape, case.coefficients)
    result = followed(one, simulated(effect, case.place, values), law=started_at_rest(one))
    assert result.diverged is None
    velocity = result.measured_velocity
    acceleration = result.acceleration
    # Shown by the encoder; or integrated by the catalogue, which a stop between samples disturbs.
    if case.effect in ("encoder_offset", "encoder_eccentricity", "elasticity", "backlash"):
        acceleration = np.gradient(velocity, 1.0 / one.rate, axis=0)
    motion = smooth(result.measured_position, velocity, acceleration, one.rate)
    torque = result.applied_torque
    if case.effect in ("time_delay", "torque_saturation"):
        torque = result.torque.copy()  # as of `applied_torque`, mean of both sides of the sample
        torque[1:] = 0.5 * (result.torque[1:] + result.torque[:-1])
    needed = inverse_dynamics(
        one.robot, one.truth, motion.position, motion.velocity, motion.acceleration
    )
    extra = torque - needed
    expected = np.zeros_like(extra)
    for joint, columns in effect.columns(motion, case.place, case.shape).items():
        expected[:, joint] = columns @ np.asarray(case.coefficients)
    w = velocity[:, 0] + np.array([1.0, -1.0])[:, None] * velocity[:, 1]
    turning = np.any(np.abs(np.column_stack([velocity, *w])) < 0.02, axis=1)
    away = np.convolve(turning, np.ones(11), "same") == 0.0
    away[-20:] = False  # a delayed torque is not known there
    return extra[away], expected[away]


@pytest.mark.parametrize("name", sorted({case.effect for case in CASES}))
def test_what_is_reported_is_what_is_simulated(name):
    """Of every kind of shape; a parameter of one side alone fails."""
    effect, names = BY_NAME[name], set()
    for case in (case for case in CASES if case.effect == name):
        names |= set(reported(effect, case.place, case.shape, case.coefficients))
    names_of_specs = {spec.name for spec in effect.specs}
    assert {effect.spec(key).name for key in names} == names_of_specs - CONSTANTS.get(name, set())


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.effect} {case.shape}")
def test_torque_of_the_simulation_is_that_of_the_catalogue(case):
    extra, expected = compare(case)
    assert len(extra) > 1000
    size = np.sqrt(np.mean(expected**2))
    assert size > 0.01
    assert np.sqrt(np.mean((extra - expected) ** 2)) < case.tolerance * size
