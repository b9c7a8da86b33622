"""Stiffness, damping, play and time offset of a gear whose numbers are known.

The recordings are simulated in `link_encoders` with SciPy: none of the project's simulator.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis.diagnose import diagnose
from idim_iv_ros.diagnosis.refit.refit import refitted
from idim_iv_ros.diagnosis.refit.smooth_motion import SmoothMotion
from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.diagnosis.result.recordings import Transmission
from idim_iv_ros.diagnosis.sentences import transmission
from idim_iv_ros.diagnosis.transmission import (
    Measured,
    measured_transmissions,
    with_transmissions,
)
from idim_iv_ros.effects.cause import EffectParameter
from idim_iv_ros.effects.two_masses import transmitted
from idim_iv_ros.identification.prepare import read_configured
from tests.diagnosis.link_encoders import Gear, pendulum_bag

SHAFT = Gear(stiffness=2e4, damping=30.0, late=0.003)
PLAY = Gear(stiffness=1e5, damping=60.0, gap=5e-4, late=-0.002)
FINE = 2.0 * np.pi / 2**16
COARSE = 2.0 * np.pi / 2**14


ERRORS = {
    "once a turn": lambda angle: 1e-3 * np.sin(angle),
    "twice a turn": lambda angle: 1e-3 * np.sin(2.0 * angle + 1.0),
    "turns -1 times": lambda angle: -2.0 * angle,
    "stands still": lambda angle: -angle,
}


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory):
    @cache
    def recorded(gear: Gear, seed: int = 1) -> tuple[Path, Configuration]:
        return pendulum_bag(tmp_path_factory.mktemp("gear"), gear, seed)

    return recorded


@pytest.fixture(scope="module")
def measure(record):
    @cache
    def measured(gear: Gear, seed: int = 1) -> Transmission:
        bag, configuration = record(gear, seed)
        refit = refitted(read_configured([bag], configuration), configuration, ())
        (joint,) = measured_transmissions(refit.data)
        return joint.result

    return measured


def within(number: EffectParameter | None, truth: float, deviations: float = 3.5) -> bool:
    assert number is not None
    assert number.std is not None
    return abs(number.value - truth) < deviations * number.std


def test_stiffness_damping_and_time_offset_of_a_shaft_are_found_within_their_intervals(measure):
    gear = measure(SHAFT)
    assert within(gear.stiffness, 2e4)
    assert within(gear.damping, 30.0)
    assert within(gear.time_offset, 0.003)
    assert gear.stiffness.std < 0.01 * gear.stiffness.value
    assert gear.backlash is None
    assert gear.reason == ""


def test_gap_of_play_is_found_beside_the_stiffness_of_its_flanks(measure):
    gear = measure(PLAY)
    assert within(gear.backlash, 5e-4)
    assert gear.backlash.std < 0.05 * gear.backlash.value
    assert gear.stiffness.value == pytest.approx(1e5, rel=0.02)
    assert within(gear.time_offset, -0.002)


@pytest.mark.parametrize("late", [0.0, 0.003])
def test_equal_encoders_with_any_time_offset_show_no_elasticity(measure, late):
    gear = measure(Gear(late=late))
    assert gear.time_offset.value == pytest.approx(late, abs=1e-5)
    assert late == 0.0 or within(gear.time_offset, late)
    assert gear.stiffness is gear.backlash is gear.lost_motion is None
    assert gear.reason and gear.stiffness_at_least > 1e6


@pytest.mark.parametrize("order", ["once a turn", "twice a turn"])
def test_an_eccentric_encoder_on_a_rigid_gear_is_no_elasticity(measure, order):
    """Gravity follows sin q, and so does an encoder that is mounted off its axis."""
    gear = measure(Gear(error=ERRORS[order]))
    assert gear.stiffness is None
    assert gear.position_error


def test_a_shaft_behind_an_eccentric_encoder_keeps_its_stiffness(measure):
    gear = measure(Gear(stiffness=2e4, damping=30.0, error=ERRORS["once a turn"]))
    assert within(gear.stiffness, 2e4)


def test_stiffness_is_found_below_the_steps_of_the_encoders_where_the_twist_is_larger(measure):
    gear = measure(Gear(stiffness=2e4, damping=30.0, step=FINE, noise=0.0))
    assert within(gear.stiffness, 2e4)
    assert gear.resolution == pytest.approx(FINE, rel=1e-6)


def test_a_twist_below_the_step_of_the_encoders_cannot_be_told(measure):
    """39 N m twist 3e5 N m/rad by a third of a step."""
    gear = measure(Gear(stiffness=3e5, damping=60.0, step=COARSE, noise=0.0))
    assert gear.stiffness is None
    assert "below the encoders' step" in gear.reason
    assert gear.stiffness_at_least < 3e5


@pytest.mark.parametrize("words", ["turns -1 times", "stands still"])
def test_an_encoder_with_another_sign_or_that_stands_still_is_named(measure, words):
    gear = measure(Gear(error=ERRORS[words]))
    assert words in gear.reason
    assert words in transmission(gear)
    assert gear.time_offset is None


@pytest.mark.slow
def test_intervals_hold_the_truth_as_often_as_they_say(measure):
    """95 % intervals of 40 recordings: at most 6 misses have a probability above 0.1 %."""
    misses = {"stiffness": 0, "time_offset": 0}
    for seed in range(100, 140):
        gear = measure(Gear(stiffness=5e4, damping=30.0, late=0.002, noise=2e-5), seed)
        misses["stiffness"] += not within(gear.stiffness, 5e4, 1.96)
        misses["time_offset"] += not within(gear.time_offset, 0.002, 1.96)
    assert max(misses.values()) <= 6, misses


@pytest.mark.slow
def test_no_elasticity_is_named_where_there_is_none(measure):
    named = [
        seed
        for seed in range(200, 230)
        if measure(Gear(late=0.002, noise=5e-5), seed).stiffness is not None
    ]
    assert not named


@pytest.fixture(scope="module")
def diagnosed(record):
    @cache
    def result(gear: Gear, without: tuple[str, ...] = ()) -> GapResult:
        bag, configuration = record(gear)
        return diagnose([bag], configuration, without=without)

    return result


def shafts(result: GapResult):
    return [cause for cause in result.causes if cause.effect in ("elasticity", "backlash")]


def test_a_measured_shaft_is_one_cause_with_the_measured_stiffness(diagnosed):
    """14 Hz against the motor: the torque alone may show it, too."""
    result = diagnosed(SHAFT)
    (cause,) = shafts(result)
    (gear,) = result.transmissions
    assert cause.effect == "elasticity"
    assert cause.parameters["stiffness"] == gear.stiffness
    assert cause.evidence.chosen_in_folds == "4 of 4"
    assert "no elasticity" in cause.sentence
    assert "elasticity at" in result.summary.lower()
    assert len(result.twists[0].load) == gear.rows


def test_measured_play_is_a_cause_with_its_gap(diagnosed):
    (cause,) = shafts(diagnosed(PLAY))
    assert cause.effect == "backlash"
    assert cause.parameters["gap"].value == pytest.approx(5e-4, rel=0.05)


def test_a_rigid_gear_with_a_late_channel_has_no_such_cause(diagnosed):
    result = diagnosed(Gear(late=0.003))
    assert not shafts(result)
    assert any("no elasticity" in note for note in result.notes)


def test_an_effect_that_is_left_out_is_not_named_from_the_encoders_either(diagnosed):
    assert not shafts(diagnosed(SHAFT, ("elasticity",)))


def test_what_the_encoders_exclude_is_taken_out_with_a_note(diagnosed):
    soft = EffectParameter(1e3, 10.0, "N m/rad")
    cause = replace(shafts(diagnosed(SHAFT))[0], parameters={"stiffness": soft})
    (rigid,) = diagnosed(Gear(late=0.003)).transmissions
    causes, measured, notes = with_transmissions(None, [Measured(0, rigid)], [cause])  # type: ignore[arg-type]
    assert causes == measured == []
    assert "excludes" in notes[0]


RATE, INERTIA, COUPLED = 500.0, 0.4, 0.15
TIME = np.arange(2000) / RATE
STIFFNESS = INERTIA * (2.0 * np.pi * 9.0) ** 2
DAMPING = 0.3 * np.sqrt(STIFFNESS * INERTIA)


def load_at(time: np.ndarray | float) -> Any:
    return 3.0 * np.sin(2.0 * np.pi * 0.8 * time) + 1.2 * np.sin(2.0 * np.pi * 3.0 * time)


def constant_link(slope: float = 0.0) -> SmoothMotion:
    """Inertias and slopes of the load do not change."""
    inertia = np.array([[1.0, COUPLED], [COUPLED, INERTIA]])
    slopes = np.tile([0.3 * slope, slope], (len(TIME), 1))
    made: Any = SimpleNamespace(
        rate=RATE,
        inertia=np.tile(inertia, (len(TIME), 1, 1)),
        load=np.column_stack([np.zeros_like(TIME), load_at(TIME)]),
        slope=lambda joint: slopes,
    )
    return cast(SmoothMotion, made)


def integrated(gap: float, slope: float, start: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Given torque, shift, its acceleration: M δ̈ = T − τ − τ' δ, flanks push only."""

    def given(shift: float, speed: float) -> float:
        bent = shift - min(max(shift, -gap / 2), gap / 2)
        if gap > 0.0 and bent == 0.0:
            return 0.0
        torque = -STIFFNESS * bent - DAMPING * speed
        return 0.0 if gap > 0.0 and torque * bent > 0.0 else torque

    def change(time: float, state: np.ndarray) -> list[float]:
        shift, speed = state
        return [speed, (given(shift, speed) - load_at(time) - slope * shift) / INERTIA]

    solution = solve_ivp(
        change, (0.0, TIME[-1]), [start, 0.0], t_eval=TIME, rtol=1e-8, atol=1e-11, max_step=1e-3
    )
    torque = np.array([given(*state) for state in solution.y.T])
    return torque, solution.y[0], (torque - load_at(TIME) - slope * solution.y[0]) / INERTIA


def relative(torque: np.ndarray, expected: np.ndarray) -> float:
    return float(np.linalg.norm(torque - expected) / np.linalg.norm(expected))


@pytest.mark.parametrize("slope", [0.0, 40.0])
def test_shaft_is_that_of_scipy(slope: float) -> None:
    motion = constant_link(slope)
    torque, shift, acceleration = integrated(0.0, slope, 0.0)
    torques = transmitted(motion, 1, STIFFNESS, DAMPING, 0.0)
    assert relative(torques[1][:, 0], torque - load_at(TIME)) < 0.03
    assert relative(torques[0][:, 0], COUPLED * acceleration + 0.3 * slope * shift) < 0.03


def test_play_is_that_of_scipy_and_leaves_the_flank() -> None:
    gap = 0.01
    torque, _, acceleration = integrated(gap, 0.0, -gap / 2)
    torques = transmitted(constant_link(), 1, STIFFNESS, DAMPING, gap)
    assert np.mean(torque == 0.0) > 0.05  # it flies
    assert relative(torques[1][:, 0], torque - load_at(TIME)) < 0.1
    assert relative(torques[0][:, 0], COUPLED * acceleration) < 0.1


def test_a_stiff_shaft_without_play_changes_nothing() -> None:
    torques = transmitted(constant_link(), 1, 1e4 * STIFFNESS, 1e2 * DAMPING, 0.0)
    assert np.abs(torques[1][50:]).max() < 1e-2 * np.abs(load_at(TIME)).max()


def test_torque_behind_a_shaft_is_not_ahead_of_its_time() -> None:
    """Of a shaft far above the motion, T − τ ≈ −M τ̈ / k: in phase with τ̈, nothing with τ̇."""
    stiffness = INERTIA * (2.0 * np.pi * 60.0) ** 2
    torques = transmitted(constant_link(), 1, stiffness, 0.3 * np.sqrt(stiffness * INERTIA), 0.0)
    change = torques[1][100:-100, 0]
    rate = np.gradient(load_at(TIME), 1.0 / RATE)
    second = np.gradient(rate, 1.0 / RATE)[100:-100]
    rate = rate[100:-100]
    delay, compliance = np.linalg.lstsq(np.column_stack([rate, second]), change, rcond=None)[0]
    assert abs(delay) < 0.1 / RATE
    assert compliance == pytest.approx(-INERTIA / stiffness, rel=0.15)
