"""Which effect is named, in worlds whose torque is written here: model + formula + noise.

The motion is that of a simulated recording; its torque is replaced, so nothing of the simulator's
effects is used.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from bags.simulated_arms import arm2
from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.held_out.held_out import held_out
from idim_iv_ros.diagnosis.localisation.unexplained import unexplained
from idim_iv_ros.diagnosis.refit.baseline import Baseline, baseline, smooth_regression
from idim_iv_ros.diagnosis.refit.noise_floor import noise_floors
from idim_iv_ros.diagnosis.refit.smooth_motion import SmoothMotion
from idim_iv_ros.diagnosis.structural import search
from idim_iv_ros.diagnosis.structural.attribution import Attribution, attribute
from idim_iv_ros.diagnosis.structural.brief import why_of_pulses
from idim_iv_ros.diagnosis.structural.candidate import operating_range
from idim_iv_ros.diagnosis.structural.causes import (
    Selection,
    built_model,
    named_model,
    structural_causes,
)
from idim_iv_ros.diagnosis.structural.cross_fitting import CrossFitting
from idim_iv_ros.diagnosis.structural.likelihood import Regression
from idim_iv_ros.diagnosis.structural.nonparametric import NONPARAMETRIC, Nonparametric
from idim_iv_ros.diagnosis.structural.rules import acceptable, with_most_of_gap
from idim_iv_ros.effects.asymmetric_friction import AsymmetricFriction
from idim_iv_ros.effects.contribution import Load
from idim_iv_ros.effects.effect import Effect, Place
from idim_iv_ros.effects.friction_drift import DriftShape, FrictionDrift
from idim_iv_ros.effects.load_dependent_friction import LoadShape
from idim_iv_ros.effects.position_ripple import PositionRipple
from idim_iv_ros.effects.registry import STRUCTURAL
from idim_iv_ros.effects.stribeck import Stribeck
from idim_iv_ros.effects.time_delay import TimeDelay
from idim_iv_ros.effects.torque_saturation import TorqueSaturation
from tests.diagnosis.simulated_sessions import arm2_session
from tests.estimation.test_simulated_arms import recorded

NOISE = (0.15, 0.05)  # N m, of a row
Torque = Callable[[SmoothMotion], np.ndarray]
EVERYTHING = (*STRUCTURAL, *NONPARAMETRIC)


@pytest.fixture(scope="module")
def data() -> Baseline:
    return arm2_session(24.0)  # a shorter session shows no drift


@pytest.fixture(scope="module", autouse=True)
def columns_made_once() -> Iterator[None]:
    """All worlds share one motion, and so the columns of the candidates."""
    original, made = search.rows_of, {}

    def remembered(data, effect, place, shapes):
        key = (id(data), effect, place, tuple(shapes))
        if key not in made:
            made[key] = original(data, effect, place, shapes)
        return made[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(search, "rows_of", remembered)
        yield


def world(
    data: Baseline, seed: int, joint: int = 0, torque: Torque | None = None, pole: float = 0.0
) -> Regression:
    """Rows of the refit with the torque of the estimate, an effect and noise."""
    random = np.random.default_rng(seed)
    plain = smooth_regression(data)
    made = []
    for number, rows in enumerate(plain.joints):
        values = rows.matrix @ data.estimate.linear.values[rows.columns]
        if torque is not None and number == joint:
            added = [m.rows(torque(m)[:, None])[m.kept[:, joint], 0] for m in data.motions]
            values = values + np.concatenate(added)
        noise = NOISE[number] * random.standard_normal(len(values) + 50)
        noise = np.sqrt(1.0 - pole**2) * lfilter([1.0], [1.0, -pole], noise)[50:]
        made.append(replace(rows, torque=values + noise))
    return Regression(tuple(made), plain.parameters)


def names_of(found: Attribution) -> list[tuple[str, int]]:
    return [(each.candidate.effect.name, each.candidate.place.joint) for each in found.found]


# Effect, joint, pole of the noise, torque.
SINGLE: list[tuple[str, int, float, Torque]] = [
    ("stribeck", 1, 0.0, lambda m: 0.5 * m.slip[:, 1] * np.exp(-((m.velocity[:, 1] / 0.15) ** 2))),
    ("position_ripple", 0, 0.7,
     lambda m: 0.5 * np.sin(23.0 * m.position[:, 0]) + 0.2 * np.cos(23.0 * m.position[:, 0])),
    ("torque_saturation", 0, 0.0,
     lambda m: 0.4 * np.sign(m.torque[:, 0]) * np.maximum(abs(m.torque[:, 0]) - 12.0, 0.0)),
    ("load_dependent_friction", 0, 0.7, lambda m: 0.1 * abs(m.load[:, 0]) * m.slip[:, 0]),
    ("friction_drift", 1, 0.0, lambda m: 0.5 * np.exp(-m.time / 5.0) * m.slip[:, 1]),
    # Much: the first scan then takes a short delay with a coefficient that physics excludes.
    ("time_delay", 1, 0.0,
     lambda m: np.interp(m.time + 0.01, m.time, m.torque[:, 1]) - m.torque[:, 1]),
    # With a constant, which is a number of the model.
    ("asymmetric_friction", 0, 0.7, lambda m: 0.4 + 0.2 * abs(m.velocity[:, 0])),
]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "joint", "pole", "torque"), SINGLE, ids=[each[0] for each in SINGLE]
)
def test_right_effect_and_joint_come_first(
    data: Baseline, name: str, joint: int, pole: float, torque: Torque
) -> None:
    found = attribute(data, world(data, 1, joint, torque, pole), EVERYTHING)
    assert names_of(found)[0] == (name, joint)
    assert len(found.found) == 1


def gravity_and_coriolis(motion: SmoothMotion) -> np.ndarray:
    """Of joint 1: what is left of the load without mass matrix times accelerations."""
    inertial = np.einsum("sj,sj->s", motion.inertia[:, 0], motion.acceleration)
    return np.asarray(motion.load[:, 0] - inertial)


@pytest.mark.parametrize(
    ("load", "torque"), [(Load.STATIC, gravity_and_coriolis), (Load.LINKS, lambda m: m.load[:, 0])]
)
def test_friction_says_which_torque_is_its_load(data: Baseline, load: Load, torque: Torque) -> None:
    rows = world(data, 5, 0, lambda m: 0.1 * abs(torque(m)) * m.slip[:, 0])
    found = attribute(data, rows, EVERYTHING)
    assert names_of(found) == [("load_dependent_friction", 0)]
    candidate = found.found[0].candidate
    assert isinstance(candidate.shape, LoadShape) and candidate.shape.load is load
    named = candidate.effect.parameters(candidate.shape, *np.zeros((2, candidate.width)))
    assert named["static_torque"].value == (load is Load.STATIC)


@pytest.fixture(scope="module")
def two_recordings() -> Baseline:
    """Of 10 s, the second a minute after the first."""
    arms = [arm2(seconds=10.0, seed=seed) for seed in (1, 2)]
    records = [replace(recorded(arm, 1), start=70.0 * k) for k, arm in enumerate(arms)]
    return baseline(records, arms[0].configuration)


@pytest.mark.parametrize("restarts", [True, False])
def test_friction_that_starts_anew_is_told_from_that_of_the_session(
    two_recordings: Baseline, restarts: bool
) -> None:
    starts = {
        id(motion): start for motion, start in zip(two_recordings.motions, (0.0, 70.0), strict=True)
    }

    def torque(m: SmoothMotion) -> np.ndarray:
        size, start, constant = (0.5, starts[id(m)], 4.0) if restarts else (1.0, 0.0, 60.0)
        return np.asarray(size * np.exp(-(m.time - start) / constant) * m.slip[:, 1])

    found = attribute(two_recordings, world(two_recordings, 6, 1, torque), [FrictionDrift()])
    (only,) = found.found
    shape = only.candidate.shape
    assert isinstance(shape, DriftShape) and shape.restarts == restarts
    assert shape.time_constant == pytest.approx(4.0 if restarts else 60.0, rel=0.3)


def test_one_recording_has_one_clock(data: Baseline) -> None:
    grid = FrictionDrift().grid(Place(0), operating_range(data))
    assert {shape.restarts for shape in grid} == {False}


def test_a_cause_says_how_well_its_numbers_are_known(data: Baseline) -> None:
    name, joint, pole, torque = SINGLE[0]
    effect = Stribeck()
    model = named_model(attribute(data, world(data, 1, joint, torque, pole), [effect]))
    floors = noise_floors(data, model.regression, model.fit, ())
    tested = held_out(data, model.regression, model.fit, [f"+{name}"], floors)
    (cause,) = structural_causes(data, model, tested, [None], [Selection("5 of 5", None, "")])
    assert cause.effect == name
    assert all(each.std is not None for each in cause.parameters.values())


def test_size_of_what_was_put_in_is_found(data: Baseline) -> None:
    name, joint, _, torque = SINGLE[0]
    found = attribute(data, world(data, 2, joint, torque), [Stribeck()])
    (only,) = found.found
    candidate = only.candidate
    assert candidate.effect.name == name
    parameters = candidate.effect.parameters(
        candidate.shape, candidate.coefficients, np.zeros(candidate.width)
    )
    assert parameters["excess"].value == pytest.approx(0.5, abs=0.1)
    assert parameters["speed"].value == pytest.approx(0.15, abs=0.05)


@pytest.mark.parametrize("pole", [0.0, 0.7], ids=["white", "coloured"])
def test_nothing_is_found_in_noise(data: Baseline, pole: float) -> None:
    for seed in range(5):
        assert names_of(attribute(data, world(data, 100 + seed, pole=pole), EVERYTHING)) == []


def test_rows_of_grids_are_kept_only_for_folds_that_judge_what_was_found(data: Baseline) -> None:
    nothing = attribute(data, world(data, 100), [Stribeck()])
    name, joint, _, torque = SINGLE[0]
    something = attribute(data, world(data, 1, joint, torque), [Stribeck()])
    assert names_of(nothing) == []
    assert nothing.grids == {}
    assert names_of(something) == [(name, joint)]
    assert {key[1].joint for key in something.grids} == {0, 1}


def pulses(motion: SmoothMotion) -> np.ndarray:
    """Six contacts of 60 ms with nothing in common."""
    starts, sizes = [2.3, 4.9, 7.1, 9.2, 11.8, 14.1], [9.0, -7.0, 8.0, -9.0, 6.0, -8.0]
    torque = np.zeros(len(motion.time))
    for start, size in zip(starts, sizes, strict=True):
        inside = (motion.time >= start) & (motion.time < start + 0.06)
        torque[inside] = size
    return torque


def wave_of_time(motion: SmoothMotion) -> np.ndarray:
    return np.asarray(1.0 * np.sin(2.0 * np.pi * 3.3 * motion.time))


def test_a_wave_of_time_is_not_named(data: Baseline) -> None:
    found = attribute(data, world(data, 3, 0, wave_of_time), EVERYTHING)
    assert named_model(found).found == ()


def test_contacts_are_not_named_but_described_with_their_joint_and_time(data: Baseline) -> None:
    found = attribute(data, world(data, 3, 0, pulses), EVERYTHING)
    assert named_model(found).found == ()
    rest = unexplained(data, named_model(found))
    assert rest is not None
    assert (rest.joint, rest.family) == ("joint_1", "event")
    assert 0.12 < rest.share <= 1.0
    seconds = float(rest.where.split(" s after its start")[0].split()[-1])
    starts = np.array([2.3, 4.9, 7.1, 9.2, 11.8, 14.1])
    assert np.abs(seconds - starts).min() < 0.3
    listed = [float(each) for each in re.findall(r"([0-9.]+) s of simulated", rest.where)]
    assert len(listed) == settings.LAW_MOST_EVENTS
    assert len({int(np.abs(starts - each).argmin()) for each in listed}) == len(listed)
    assert max(np.abs(starts - each).min() for each in listed) < 0.3
    quiet = attribute(data, world(data, 4), ())
    assert unexplained(data, named_model(quiet)) is None


def late(motion: SmoothMotion) -> np.ndarray:
    """Torque of joint 1 that acts 10 ms after its command."""
    torque = motion.torque[:, 0]
    return np.asarray(np.interp(motion.time + 0.01, motion.time, torque) - torque)


@pytest.mark.parametrize(("everywhere", "named"), [(True, True), (False, False)])
def test_a_delay_that_is_seen_beside_pulses_only_is_none(
    data: Baseline, everywhere: bool, named: bool
) -> None:
    """The law answers a pulse: what follows it looks like a late torque."""

    def torque(motion: SmoothMotion) -> np.ndarray:
        pushed = pulses(motion)
        near = np.convolve(pushed != 0.0, np.ones(round(0.2 * motion.rate)), "same") > 0.0
        return np.asarray(pushed + late(motion) * (1.0 if everywhere else near))

    delays = attribute(data, world(data, 7, 0, late), [TimeDelay()])
    rows = world(data, 7, 0, torque)
    attribution = replace(delays, regression=rows, refit=rows.fit())
    model = built_model(attribution, list(delays.found), [])
    assert [each.candidate.effect.name for each in model.found] == ["time_delay"]
    assert (why_of_pulses(data, model, 0) == "") == named


@pytest.mark.parametrize(("kind", "unit"), [("revolute", "rad"), ("prismatic", "m")])
def test_a_stop_is_described_with_its_place_in_the_units_of_its_joint(
    data: Baseline, kind: str, unit: str
) -> None:
    highest = float(data.motions[0].position[:, 0].max())

    def stop(motion: SmoothMotion) -> np.ndarray:
        return np.asarray(40.0 * np.maximum(motion.position[:, 0] - (highest - 0.2), 0.0))

    found = named_model(attribute(data, world(data, 6, 0, stop), NONPARAMETRIC))
    model = data.prepared.model
    robot = replace(model.robot, joint_types=(kind, "revolute"))
    changed = replace(data, prepared=replace(data.prepared, model=replace(model, robot=robot)))
    rest = unexplained(changed, found)
    assert rest is not None
    assert "beyond one position" in rest.where
    number, name = rest.where.split("above ")[1].split()
    assert float(number) == pytest.approx(highest - 0.2, abs=0.05)
    assert name == unit


class Twin(Stribeck):
    """The same torque under another name."""

    name = "twin"


class Slower(TorqueSaturation):
    """Another torque."""

    name = "other"


def test_effects_with_the_same_torque_are_indistinguishable(
    data: Baseline,
) -> None:
    _, joint, _, torque = SINGLE[0]
    catalogue: list[Effect] = [Stribeck(), Twin(), Slower()]
    found = attribute(data, world(data, 5, joint, torque), catalogue)
    (only,) = CrossFitting(data, found).with_sets(found.found)
    assert only.candidate.effect.name in ("stribeck", "twin")
    ((rival, correlation),) = only.indistinguishable_from
    assert {rival.effect.name, only.candidate.effect.name} == {"stribeck", "twin"}
    assert correlation == pytest.approx(1.0, abs=1e-3)


def test_support_is_gain_less_schwarz_and_the_logarithm_of_the_grid(data: Baseline) -> None:
    _, joint, _, torque = SINGLE[0]
    found = attribute(data, world(data, 5, joint, torque), [Stribeck()])
    candidate = found.found[0].candidate
    rows = len(found.regression.joints[joint].torque)
    # Both with the colours of the larger: the smaller's own would take the effect for noise.
    both = [found.regression.fit(found.fit.noise_models, steps=0), found.fit]
    white = [
        [
            c.standardized(r, data.segments)
            for c, r, data in zip(
                found.fit.noise_models, fit.residuals, found.regression.joints, strict=True
            )
        ]
        for fit in both
    ]
    gain = sum(
        0.5 * len(one) * np.log((one @ one) / (two @ two)) for one, two in zip(*white, strict=True)
    )
    # One coefficient, a speed and an exponent, from a grid of 8 speeds and 3 exponents.
    expected = gain - 1.5 * np.log(rows) - np.log(24)
    assert candidate.support == pytest.approx(expected, abs=0.5)
    assert acceptable(candidate)
    assert not acceptable(replace(candidate, gain=candidate.cost + 7.9))
    assert acceptable(replace(candidate, gain=max(candidate.cost + 8.1, 0.006 * rows)))
    assert not acceptable(replace(candidate, gain=0.004 * rows))  # 0.8 % of the energy


def slow_and_fast(motion: SmoothMotion) -> np.ndarray:
    """A wide slow gap and a narrow fast one, which the noise hides far less."""
    return np.asarray(
        0.3 * abs(motion.velocity[:, 1]) + 0.12 * np.sin(40.0 * motion.position[:, 1])
    )


def test_what_closes_most_of_the_gap_comes_before_what_is_surest(data: Baseline) -> None:
    regression = world(data, 8, 1, slow_and_fast, pole=0.97)
    effects: list[Effect] = [AsymmetricFriction(), PositionRipple()]
    found = attribute(data, regression, effects)
    assert names_of(found) == [("asymmetric_friction", 1), ("position_ripple", 1)]
    alone = [attribute(data, regression, [effect]).found[0].candidate for effect in effects]
    assert alone[0].support < alone[1].support
    assert alone[0].explained > 2.0 * alone[1].explained
    assert with_most_of_gap(alone) == alone[:1]
    assert with_most_of_gap([replace(alone[0], explained=0.0), alone[1]]) == alone[1:]


def test_two_effects_at_two_joints_are_found_one_after_the_other(data: Baseline) -> None:
    both = world(data, 6, SINGLE[0][1], SINGLE[0][3])
    ripple = world(data, 6, 0, SINGLE[1][3])
    mixed = Regression((ripple.joints[0], both.joints[1]), both.parameters)
    found = attribute(data, mixed, EVERYTHING)
    assert set(names_of(found)) == {("stribeck", 1), ("position_ripple", 0)}
    model = named_model(found)
    assert [len(fit.coefficients) for fit in model.fits] == [
        0, model.regression.widths[0], sum(model.regression.widths),
    ]  # fmt: skip
    gains = np.diff([fit.log_likelihood for fit in model.fits])
    assert np.all(gains > 8.0)


def test_a_name_that_patches_a_nonparametric_function_at_its_joint_is_dropped(
    data: Baseline,
) -> None:
    found = attribute(data, world(data, 6, SINGLE[1][1], SINGLE[1][3]), [PositionRipple()])
    (named,) = found.found
    generic: Nonparametric = NONPARAMETRIC[0]
    here = replace(named, candidate=replace(named.candidate, effect=generic))
    elsewhere = replace(
        here,
        candidate=replace(
            here.candidate, columns={1: next(iter(named.candidate.columns.values()))}
        ),
    )
    patched = named_model(replace(found, found=(here, named)))
    assert (patched.found, patched.nonparametric) == ((), (here,))
    assert len(patched.fits) == 1
    kept = named_model(replace(found, found=(elsewhere, named)))
    assert (kept.found, kept.nonparametric) == ((named,), (elsewhere,))
    # What was found before the nonparametric function stands by itself.
    before = named_model(replace(found, found=(named, here)))
    assert before.found == (named,)
