"""The search on worlds whose torque is written here, and its algebra against dense formulas."""

import re
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from bags.simulated_arms import arm2
from idim_iv_ros.diagnosis import sentences
from idim_iv_ros.diagnosis.answer.causes import hints_of, signal_notes, structural_causes
from idim_iv_ros.diagnosis.answer.explained import NO_HELP, explained, unexplained
from idim_iv_ros.diagnosis.comparison.candidate import Catalogue
from idim_iv_ros.diagnosis.comparison.folds import chosen_without
from idim_iv_ros.diagnosis.comparison.ledger import torque_ledger
from idim_iv_ros.diagnosis.comparison.model_with_terms import ModelWithTerms, NominalErrors
from idim_iv_ros.diagnosis.comparison.refine import stopped_by_physics
from idim_iv_ros.diagnosis.comparison.select import Selection, select
from idim_iv_ros.diagnosis.refit.baseline import Baseline, baseline
from idim_iv_ros.diagnosis.refit.held_out import HeldOut
from idim_iv_ros.diagnosis.refit.smooth_motion import SmoothMotion
from idim_iv_ros.effects.contribution import Load
from idim_iv_ros.effects.effect import Place
from idim_iv_ros.effects.elasticity import ShaftShape
from idim_iv_ros.effects.friction_drift import DriftShape
from idim_iv_ros.effects.load_dependent_friction import LoadShape
from idim_iv_ros.effects.registry import BY_NAME, PARAMETRIC, STRUCTURAL
from idim_iv_ros.effects.spring import LineShape
from idim_iv_ros.estimation.likelihood import Regression
from tests.diagnosis.motions import arm2_session, gravity_and_coriolis
from tests.diagnosis.worlds import NOISE, PULSES, SINGLE, Torque, pulses, world
from tests.estimation.test_simulated_arms import recorded

SECONDS = 24.0  # a shorter session shows no drift
NAMES = [effect.name for effect in (*STRUCTURAL, *PARAMETRIC)]


@pytest.fixture(scope="module")
def data() -> Baseline:
    return arm2_session(SECONDS)


def selected(data: Baseline, regression: Regression, *only: str) -> Selection:
    """What the search takes of some effects; of all, if none are named."""
    without = [name for name in NAMES if only and name not in only]
    changed = replace(data, regression=regression)
    return select(Catalogue(changed, without), torque_ledger(changed))


def names_of(selection: Selection) -> list[tuple[str, int | None]]:
    return [term.key[:2] for term in selection.terms]


@cache
def single(number: int) -> Selection:
    """What is taken of a world with one effect."""
    _, joint, pole, torque = SINGLE[number]
    data = arm2_session(SECONDS)
    return selected(data, world(data, 1, joint, torque, pole=pole))


@pytest.mark.parametrize("number", range(len(SINGLE)), ids=lambda number: SINGLE[number][0])
def test_one_effect_is_selected_alone(number: int) -> None:
    assert names_of(single(number)) == [SINGLE[number][:2]]


def test_nothing_is_selected_in_autocorrelated_noise(data: Baseline) -> None:
    """In white noise: `test_nothing_is_wrong_where_nothing_was_changed`."""
    for seed in range(3):
        assert names_of(selected(data, world(data, 100 + seed, pole=0.7))) == []


def test_two_effects_at_two_joints(data: Baseline) -> None:
    friction = world(data, 6, SINGLE[0][1], SINGLE[0][3])
    ripple = world(data, 6, 0, SINGLE[1][3])
    mixed = Regression((ripple.joints[0], friction.joints[1]), friction.parameters)
    assert set(names_of(selected(data, mixed))) == {("stribeck", 1), ("position_ripple", 0)}


@pytest.mark.parametrize("of_gain", [True, False], ids=["gain", "torque"])
def test_a_gain_that_ripples_is_no_torque_that_ripples(data: Baseline, of_gain: bool) -> None:
    """Of the same size over the same position, one times the torque, the other not."""

    def torque(m: SmoothMotion) -> np.ndarray:
        wave = np.sin(31.0 * m.position[:, 0] + 0.4)
        return np.asarray(0.04 * m.torque[:, 0] * wave if of_gain else 0.4 * wave)

    selection = selected(data, world(data, 20, 0, torque))
    (term,) = selection.terms
    assert term.key[:2] == ("gain_ripple" if of_gain else "position_ripple", 0)
    assert dict(term.rivals)[term.key] > 0.99
    assert term.shape is not None and term.shape.numbers[0] == pytest.approx(31.0, rel=0.01)
    assert np.hypot(*term.coefficients) == pytest.approx(0.04 if of_gain else 0.4, rel=0.2)
    said = signal_notes(data.joints, [term])
    assert len(said) == of_gain and all("joint_1" in note for note in said)
    if of_gain:  # and were it as likely a torque that ripples, the note would say so
        assert "position ripple" not in said[0]
        rival = ("position_ripple", *term.key[1:])
        as_likely = replace(term, rivals=((term.key, 0.55), (rival, 0.45)))
        (note,) = signal_notes(data.joints, [as_likely])
        assert "position ripple of joint_1 (45 %)" in note
    else:  # and were it as likely the gain's, it would be no cause
        rival = term.key._replace(effect="gain_ripple")
        as_likely = replace(term, rivals=((term.key, 0.55), (rival, 0.45)))
        assert [effect.term.key for effect in explained(selection).effects] == [term.key]
        explanation = explained(replace(selection, terms=(as_likely,)))
        (hint,) = explanation.doubtful
        assert not explanation.effects and hint.too_unsure == pytest.approx(0.55, abs=0.02)


def test_a_ripple_finer_than_the_grid_is_the_gain_s(data: Baseline) -> None:
    """Waves of the grid's end favour a torque; refined, the same waves of the gain are likelier."""

    def torque(m: SmoothMotion) -> np.ndarray:
        return np.asarray(0.04 * m.torque[:, 0] * np.sin(274.0 * m.position[:, 0] + 0.4))

    assert names_of(selected(data, world(data, 20, 0, torque))) == [("gain_ripple", 0)]


def test_what_shapes_miss_at_one_joint_says_nothing_of_another() -> None:
    comparison = single(0).comparison
    (term,) = single(0).terms
    at_first = replace(term, visible=np.array([0.2, 0.0]))
    scores, information = np.array([[9.0]]), np.array([[1e6]])

    def evidence(*shares: float, beside: bool) -> float:
        of_joints, others = np.array([shares]), [at_first] if beside else []
        made = comparison.beyond_misfit(scores, information, of_joints, of_joints, others)
        return float(made[0])

    assert evidence(0.0, 1.0, beside=True) == evidence(0.0, 1.0, beside=False) > 20.0
    assert evidence(1.0, 0.0, beside=True) < 1.0
    assert evidence(0.5, 0.5, beside=True) > 0.4 * evidence(0.5, 0.5, beside=False)


@pytest.mark.parametrize(
    ("stiffness", "part"),
    [(8.0, 0.25), (1.0, 0.25), (2.0, 0.3), (0.0, 0.25)],
    ids=["stop", "soft stop", "stop like a spring and a ripple", "spring"],
)
def test_a_stop_at_one_side_is_no_spring(data: Baseline, stiffness: float, part: float) -> None:
    """A bumper that is met at the end of the range, and a cable that stiffens over all of it."""
    position = np.concatenate([motion.position[:, 1] for motion in data.motions])
    low, high = float(position.min()), float(position.max())
    start, span = high - part * (high - low), high - low

    def torque(m: SmoothMotion) -> np.ndarray:
        beyond = np.maximum(m.position[:, 1] - start, 0.0) / span
        meets = beyond * (stiffness + 0.4 * m.velocity[:, 1])
        stiffens = 0.15 * np.sinh((m.position[:, 1] - 0.5 * (low + high)) / (0.2 * span))
        return np.asarray(meets if stiffness else stiffens)

    rows, one_sided = world(data, 21, 1, torque), bool(stiffness)
    selection = selected(data, rows)
    assert names_of(selection) == ([] if one_sided else [("spring", 1)])
    assert [curve.effect.name for curve in selection.curves] == (
        ["contact beyond a position"] if one_sided else []
    )
    hints = [hint.effect for hint in hints_of(explained(selection))]
    assert hints.count("spring") == one_sided


def test_a_spring_rests_where_it_rests(data: Baseline) -> None:
    """Far from where the joint is: as a line through zero it would be bent, or a free curve."""
    regression = world(data, 9, 1, lambda m: 1.5 * (m.position[:, 1] - 2.0))
    (term,) = selected(data, regression).terms
    assert term.key[:2] == ("spring", 1)
    assert isinstance(term.shape, LineShape)
    assert term.coefficients == pytest.approx([-3.0, 1.5], rel=0.05)


def test_friction_over_the_position_has_its_name_in_any_form(data: Baseline) -> None:
    """Three plateaus are no wave and no spot; what these leave is not outside the catalogue."""
    position = np.concatenate([motion.position[:, 1] for motion in data.motions])
    steps = np.quantile(position, [0.3, 0.6])

    def torque(m: SmoothMotion) -> np.ndarray:
        level = np.array([0.3, 1.0, 0.5])[np.searchsorted(steps, m.position[:, 1])]
        return np.asarray(level * m.slip[:, 1])

    selection = selected(data, world(data, 22, 1, torque))
    assert ("position_dependent_friction", 1) in names_of(selection)
    assert not selection.displaced
    assert "friction over position" not in [curve.effect.name for curve in selection.curves]


@pytest.mark.parametrize(
    ("load", "torque"),
    [(Load.STATIC, lambda m: gravity_and_coriolis(m, 0)), (Load.LINKS, lambda m: m.load[:, 0])],
)
def test_friction_says_which_torque_is_its_load(data: Baseline, load: Load, torque: Torque) -> None:
    rows = world(data, 5, 0, lambda m: 0.1 * abs(torque(m)) * m.slip[:, 0])
    (term,) = selected(data, rows).terms
    assert term.key[:2] == ("load_dependent_friction", 0)
    assert isinstance(term.shape, LoadShape) and term.shape.load is load


@pytest.fixture(scope="module")
def two_recordings() -> Baseline:
    """Of 10 s, the second a minute after the first."""
    arms = [arm2(seconds=10.0, rate=500.0, seed=seed) for seed in (1, 2)]
    records = [replace(recorded(arm, 1), start=70.0 * k) for k, arm in enumerate(arms)]
    return baseline(records, arms[0].configuration)


@pytest.mark.parametrize("restarts", [True, False])
def test_friction_that_starts_anew_is_told_from_that_of_the_session(two_recordings, restarts):
    starts = {
        id(motion): start for motion, start in zip(two_recordings.motions, (0.0, 70.0), strict=True)
    }

    def torque(m: SmoothMotion) -> np.ndarray:
        size, start, constant = (0.5, starts[id(m)], 4.0) if restarts else (1.0, 0.0, 60.0)
        return np.asarray(size * np.exp(-(m.time - start) / constant) * m.slip[:, 1])

    (term,) = selected(two_recordings, world(two_recordings, 6, 1, torque), "friction_drift").terms
    assert isinstance(term.shape, DriftShape) and term.shape.restarts == restarts
    assert term.shape.time_constant == pytest.approx(4.0 if restarts else 60.0, rel=0.3)


def test_a_cause_has_numbers_intervals_and_a_probability() -> None:
    (cause,) = structural_causes(explained(single(0)), [None])
    assert (cause.effect, cause.joint) == ("stribeck", "joint_2")
    assert cause.probability is not None and cause.probability > 0.8
    assert cause.parameters["excess"].value == pytest.approx(0.5, abs=0.1)
    assert cause.parameters["speed"].value == pytest.approx(0.15, abs=0.05)
    assert all(number.std is not None for number in cause.parameters.values())
    assert cause.torque_gap.after < 0.6 * cause.torque_gap.before
    assert f"{100 * cause.probability:.0f} %" in cause.sentence


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_free_numbers_do_not_need_stays_where_it_predicts_every_part(monkeypatch, sign):
    """Of a short recording new numbers, all of them free, predict a held-out part by chance."""
    monkeypatch.setattr(HeldOut, "helps", lambda *_: False)
    chosen = chosen_without(single(0))
    gains = sign * np.abs(chosen.gains)
    monkeypatch.setattr(
        "idim_iv_ros.diagnosis.answer.explained.chosen_without",
        lambda _: replace(chosen, gains=gains),
    )
    explanation = explained(single(0))
    assert len(explanation.effects) == (sign > 0.0)
    assert {one.reason for one in explanation.doubtful} == ({NO_HELP} if sign < 0.0 else set())


def test_contacts_are_events_with_their_joint_and_times(data: Baseline) -> None:
    explanation = explained(selected(data, world(data, 3, 0, pulses)))
    assert (explanation.effects, explanation.numbers) == ((), ())
    rest = unexplained(explanation)
    assert rest is not None
    assert (rest.joint, rest.family) == ("joint_1", "event")
    listed = [float(time) for time in re.findall(r"([0-9.]+) s of simulated", rest.where)]
    assert len(listed) == sentences.MOST_EVENTS
    assert max(np.abs(np.array(PULSES) - time).min() for time in listed) < 0.3


def test_evidence_of_a_model_is_that_of_the_dense_formula() -> None:
    """ln N(r; 0, I + X S Sᵀ Xᵀ + Σ A P Pᵀ Aᵀ), less that of noise alone, all whitened."""
    selection = single(0)
    comparison = selection.comparison
    nominal: NominalErrors = comparison.nominal
    ledger, white = comparison.options.ledger, nominal.white
    ends = np.cumsum([0, *map(len, white.gap)])
    rows = [slice(begin, end) for begin, end in pairwise(ends)]
    model = np.zeros((rows[-1].stop, ledger.parameters))
    for part, one, matrix in zip(rows, ledger.joints, white.model, strict=True):
        model[part, one.columns] = matrix
    gap = np.concatenate(white.gap)
    sizes = np.hstack(
        [nominal.errors[0] * ledger.link_errors, nominal.errors[1] * ledger.drive_errors]
    )
    (term,) = selection.terms
    column = np.zeros((len(gap), term.width))
    for at, matrix in term.columns.items():
        one = ledger.joints[at]
        column[rows[at]] = white.noise[at].standardized(matrix, one.segments)
    factors = np.hstack([model @ sizes, column @ term.prior_root])
    covariance = np.eye(len(gap)) + factors @ factors.T
    sign, logdet = np.linalg.slogdet(covariance)
    dense = 0.5 * gap @ gap - 0.5 * gap @ np.linalg.solve(covariance, gap) - 0.5 * logdet
    assert sign > 0
    assert ModelWithTerms(nominal, (term,)).level == pytest.approx(dense, rel=1e-6)


def test_noise_that_is_larger_where_the_torque_is_large_is_no_evidence_for_what_acts_there(data):
    """Noise of one size everywhere would name something in most of these worlds."""
    for seed in range(3):
        plain, rng = world(data, seed), np.random.default_rng(seed)
        rows = plain.joints[1]
        large = np.abs(rows.torque) > np.quantile(np.abs(rows.torque), 0.97)
        louder = rows.torque + np.where(large, 12.0 * NOISE[1], 0.0) * rng.normal(size=len(rows))
        joints = (plain.joints[0], replace(rows, torque=louder))
        regression = Regression(joints, plain.parameters)
        names = "torque_saturation", "asymmetric_friction", "position_dependent_friction"
        assert names_of(selected(data, regression, *names)) == []


@pytest.mark.parametrize("swing", [3.4, 9.0], ids=["softer than arms", "of an arm"])
def test_a_shaft_that_no_arm_has_is_a_hint(data: Baseline, swing: float) -> None:
    """Also where its search has stopped at the edge of what arms have."""
    inertia, elasticity = data.covered[1].inertia, BY_NAME["elasticity"]
    stiffness = inertia * (2.0 * np.pi * swing) ** 2
    shape = ShaftShape(stiffness, 0.2 * np.sqrt(stiffness * inertia))

    def torque(m: SmoothMotion) -> np.ndarray:
        return np.asarray(elasticity.columns(m, Place(1), shape)[1][:, 0])

    selection = selected(data, world(data, 22, 1, torque), "elasticity")
    comparison, catalogue = selection.comparison, selection.catalogue
    term, *others = sorted(selection.terms, key=lambda term: not term.is_effect)
    if swing < 4.0:  # move it to where it would be possible
        stiffer = replace(term.shape, stiffness=1.5 * stiffness * float(term.coefficients[0]))
        (columns,) = catalogue.columns_of(term.candidate, [stiffer])
        term = replace(term, shape=stiffer, columns=dict(columns))
    one = np.ones(1)
    assert not catalogue.why_impossible(term.candidate, term.shape, term.coefficients, one)
    why = stopped_by_physics(comparison, [term, *others], 0)
    assert why.startswith("the link would swing at 3.") == (swing < 4.0) == bool(why)
