"""The simulated motion: closer to a measured one, with the law's speed, and at each stage."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bags.simulated_arms import SimulatedArm, arm2
from idim_iv_ros.diagnosis.comparison.candidate import Catalogue, Kind
from idim_iv_ros.diagnosis.identifiability import not_shown_by_motion
from idim_iv_ros.diagnosis.refit.baseline import Baseline, baseline
from idim_iv_ros.diagnosis.refit.noise_floor import noise_floors, repeats_of
from idim_iv_ros.diagnosis.refit.smooth_motion import corrected_motions, high_passed
from idim_iv_ros.diagnosis.tracking import (
    simulated_tracking,
    simulation_gaps,
    tracked_stages,
    tracking_series,
)
from idim_iv_ros.diagnosis.where import where
from idim_iv_ros.effects.cause import EffectParameter
from idim_iv_ros.effects.effect import Place
from idim_iv_ros.effects.registry import STRUCTURAL
from idim_iv_ros.estimation.instruments import SimulatedLoop
from idim_iv_ros.estimation.likelihood import Fit
from idim_iv_ros.recording.recording import Recording
from idim_iv_ros.signals.decimation import ParallelDecimation
from idim_iv_ros.simulation import ControlLaw
from tests.estimation.test_simulated_arms import recorded
from tests.inputs import changed

RATE, CUTOFF = 500.0, 20.0


def sines(seconds: float = 20.0, seed: int = 0) -> list[np.ndarray]:
    """Position and its first four derivatives of two joints, (s, 2) each."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * RATE)) / RATE
    pulsation = 2.0 * np.pi * rng.uniform(0.5, CUTOFF, (2, 25))
    phase = rng.uniform(0.0, 2.0 * np.pi, (2, 25))
    size = 0.3 / pulsation**1.5
    angle = pulsation * time[:, None, None] + phase
    return [
        np.sum(size * pulsation**order * np.sin(angle + 0.5 * np.pi * order), axis=2)
        for order in range(5)
    ]


def other_loop(states: list[np.ndarray], order: int) -> np.ndarray:
    """The same derivative where the loop is 2 % weaker, 3 ms later, and the joints are coupled."""
    here, first, second = states[order : order + 3]
    return 0.98 * here - 3e-3 * first + 4e-6 * second + 0.01 * here[:, ::-1]


def difference(one: list[np.ndarray], other: list[np.ndarray]) -> float:
    """Of two accelerations where the motions join and above, as a share of the first's."""
    inner = slice(500, -500)
    rest, whole = (high_passed(x, RATE, CUTOFF)[inner] for x in (one[2] - other[2], one[2]))
    return float(np.std(rest) / np.std(whole))


@pytest.mark.parametrize("noise", [0.0, 2e-5])
def test_what_another_loop_does_to_the_motion_is_taken_over_without_its_noise(noise) -> None:
    states = sines()
    real = [other_loop(states, order) for order in range(3)]
    rng = np.random.default_rng(1)
    pulsation = 2.0 * np.pi * CUTOFF
    measured = [
        values + noise * pulsation**order * rng.standard_normal(values.shape)
        for order, values in enumerate(real)
    ]
    decimation = ParallelDecimation(10, len(states[0]), 0.8)
    motion: Any = SimpleNamespace(decimation=decimation, signals=SimpleNamespace(rate=RATE))
    (corrected,) = corrected_motions([motion], [measured], [states[:3]], CUTOFF)
    assert difference(real, states[:3]) > 0.2
    assert difference(real, corrected) < 0.01
    assert difference(real, corrected) <= max(0.2 * difference(real, measured), 1e-3)


FACTOR = 0.25  # 3.5 ms late at 1 kHz


@pytest.fixture(scope="module")
def late(arm: SimulatedArm) -> Recording:
    robot = replace(arm, law=replace(arm.law, speed_factor=FACTOR))
    return recorded(robot, 1)


@pytest.fixture(scope="module")
def data(arm: SimulatedArm, late: Recording) -> Baseline:
    return baseline([late], arm.configuration)


def law_of(data: Baseline) -> ControlLaw:
    source = data.sources.sources[0]
    assert isinstance(source, SimulatedLoop)
    return source.laws[0]


def tracking(data: Baseline) -> np.ndarray:
    """Simulated less measured motion of the refit, rms of each joint, rad."""
    rms = simulated_tracking(data, data.estimate.linear.values).rms
    assert rms is not None
    return np.array(list(rms.values()))


def with_exact_speed(data: Baseline) -> Baseline:
    source = data.sources.sources[0]
    exact = replace(source, laws=tuple(replace(law, speed_factor=None) for law in source.laws))
    return replace(data, sources=replace(data.sources, sources=(exact, *data.sources.sources[1:])))


def test_the_filter_is_found_and_the_loop_moves_as_the_robot(data: Baseline) -> None:
    assert law_of(data).speed_factor == pytest.approx(FACTOR, rel=0.1)
    assert np.all(tracking(data) < 0.25 * tracking(with_exact_speed(data)))


def test_a_law_with_the_exact_speed_keeps_it(arm: SimulatedArm) -> None:
    assert law_of(baseline([recorded(arm, 1)], arm.configuration)).speed_factor is None


def effect_of(name: str, **numbers: float) -> Any:
    """A cause whose effect has these numbers, whatever its coefficients."""
    parameters = {key: EffectParameter(value, None, "") for key, value in numbers.items()}
    effect = SimpleNamespace(name=name, parameters=lambda *_: parameters)
    return SimpleNamespace(term=SimpleNamespace(effect=effect, place=Place(0), shape=None))


def test_effects_that_cannot_be_simulated_do_not_end_the_simulation(data: Baseline) -> None:
    fit = SimpleNamespace(values=data.estimate.linear.values, coefficients=np.zeros(2))
    effects = (effect_of("no such effect"), effect_of("spring", linear=40.0))
    regression = SimpleNamespace(blocks=(slice(0, 1), slice(1, 2)))
    explanation: Any = SimpleNamespace(
        data=data, effects=effects, fits=[fit] * 3, fit=fit, regression=regression
    )
    _, refit, unknown, spring = tracked_stages(explanation)
    assert (refit.note, refit.caveat) == ("", "")
    assert (unknown.note, unknown.rms) == ("", refit.rms)
    assert "no such effect" in unknown.caveat
    assert (spring.note, spring.caveat) == ("", "")
    assert spring.rms is not None and refit.rms is not None
    assert spring.rms["joint_1"] > 2.0 * refit.rms["joint_1"]


@pytest.fixture(scope="module")
def base() -> Baseline:
    arm = arm2(seconds=10.0, rate=500.0)
    return baseline([recorded(arm, seed) for seed in (1, 2)], arm.configuration)


@pytest.fixture(scope="module")
def fit(base: Baseline) -> Fit:
    return base.regression.fit()


def test_repeats_tell_the_noise_that_was_put_in(base: Baseline, fit: Fit) -> None:
    repeats = repeats_of(base)
    assert [(r.first, r.second, r.lag) for r in repeats] == [(0, 1, 0)]
    limits = np.asarray(base.prepared.configuration.controller.torque_limit)
    rate, edge = base.prepared.motions[0].signals.rate, base.motions[0].decimation.edge
    # White noise of 0.5 % of the limit, through a filter that passes this share of the band.
    expected = 0.005 * limits * np.sqrt(edge * base.row_rate / rate)
    for floor, value in zip(noise_floors(base, fit, repeats), expected, strict=True):
        assert floor.origin == "repeats"
        assert floor.sigma == pytest.approx(value, rel=0.15)
    for floor, colour in zip(noise_floors(base, fit, ()), fit.noise_models, strict=True):
        assert floor.origin == "lower bound"
        assert floor.sigma == colour.sigma


def test_efforts_in_ampere_are_not_compared_with_a_model_in_newton_metres(base, fit: Fit) -> None:
    configuration = changed(base.prepared.configuration, "signals", effort_unit="A")
    current = replace(base.prepared, configuration=configuration)
    ampere = replace(base, prepared=current)
    assert current.given is None
    assert "efforts are in A" in current.why_no_given
    kinds = [{one.kind for one in Catalogue(data).candidates} for data in (ampere, base)]
    assert [Kind.NUMBER in some for some in kinds] == [False, True]
    gaps, _ = where(ampere, noise_floors(base, fit, ()))
    assert gaps.joints[0].rms == pytest.approx(np.sqrt(np.mean(fit.residuals[0] ** 2)))
    assert {regime.unit for regime in gaps.regimes if regime.axis == "load"} <= {"A"}


def test_more_noise_hides_more(base: Baseline, fit: Fit) -> None:
    loud = tuple(
        replace(noise, innovation_variance=900.0 * noise.innovation_variance)
        for noise in fit.noise_models
    )
    few = not_shown_by_motion(base, STRUCTURAL, fit.noise_models)
    many = not_shown_by_motion(base, STRUCTURAL, loud)
    assert len(many) > len(few) + 5
    assert {(n.effect, n.joint) for n in few} <= {(n.effect, n.joint) for n in many}
    assert all(refusal.reason and refusal.excitation_needed for refusal in many)


def test_the_refit_tracks_better_than_the_given_model(base: Baseline) -> None:
    values = base.prepared.given, base.estimate.linear.values
    before, after = (simulated_tracking(base, numbers) for numbers in values)
    effect = SimpleNamespace(term=SimpleNamespace(place=Place(0)))
    explanation: Any = SimpleNamespace(fits=(None, None), effects=(effect,))
    (gap,) = simulation_gaps(explanation, [before, after])
    assert gap.before == pytest.approx(before.rms["joint_1"])
    assert gap.shrinkage > 0.3
    series = tracking_series(before, after)
    assert len(series) == 4
    assert max(len(one.time) for one in series) <= 1500
    # Reference less simulated, less reference less measured: what the simulation misses.
    missed = np.sqrt(np.mean([(s.after - s.measured) ** 2 for s in series[::2]]))
    assert missed == pytest.approx(after.rms["joint_1"], rel=0.1)
