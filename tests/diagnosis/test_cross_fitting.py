"""Choices, scores and predictions without a fold, against fits of the rows by a direct QR."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.held_out.held_out import folds_of, held_out
from idim_iv_ros.diagnosis.parametric.errors_beyond_base import ErrorBeyondBase
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.structural.attribution import Attribution, attribute
from idim_iv_ros.diagnosis.structural.calibration import (
    largest_support,
    null_noise,
    null_supports,
    p_value,
)
from idim_iv_ros.diagnosis.structural.candidate import operating_range
from idim_iv_ros.diagnosis.structural.confidence import held_out_losses, included
from idim_iv_ros.diagnosis.structural.cross_fitting import CrossFitting
from idim_iv_ros.diagnosis.structural.fold_model import FoldModel
from idim_iv_ros.diagnosis.structural.fold_products import FoldProducts
from idim_iv_ros.diagnosis.structural.fold_search import FoldSearch
from idim_iv_ros.diagnosis.structural.likelihood import Columns, Regression
from idim_iv_ros.diagnosis.structural.menu import Menu, menu_of
from idim_iv_ros.diagnosis.structural.nonparametric import NONPARAMETRIC, Nonparametric
from idim_iv_ros.effects.effect import Effect, OperatingRange, Place, Shape
from idim_iv_ros.effects.joint_coupling import JointCoupling
from idim_iv_ros.effects.load_dependent_friction import LoadDependentFriction
from idim_iv_ros.effects.motion import RobotMotion
from idim_iv_ros.effects.stribeck import Stribeck, StribeckShape
from idim_iv_ros.effects.torque_saturation import TorqueSaturation
from idim_iv_ros.signals import AutoregressiveModel
from tests.diagnosis.simulated_sessions import arm2_session
from tests.diagnosis.test_attribution import SINGLE, world

CATALOGUE: list[Effect] = [
    Stribeck(), LoadDependentFriction(), JointCoupling(), TorqueSaturation(), *NONPARAMETRIC
]  # fmt: skip
OUT = 1  # the fold that is left out


@pytest.fixture(scope="module")
def data() -> Baseline:
    return arm2_session(24.0)


@pytest.fixture(scope="module")
def found(data: Baseline) -> Attribution:
    _, joint, _, torque = SINGLE[0]
    return attribute(data, world(data, 1, joint, torque, 0.7), CATALOGUE)


@pytest.fixture(scope="module")
def menu(data: Baseline, found: Attribution) -> Menu:
    return menu_of(CATALOGUE, operating_range(data), found.grids)


@pytest.fixture(scope="module")
def products(data: Baseline, found: Attribution, menu: Menu) -> FoldProducts:
    folds, _ = folds_of(data, ())
    return FoldProducts(found.regression, found.fit.noise_models, found.refit.values, folds, menu)


@pytest.fixture(scope="module")
def direct(
    products: FoldProducts, found: Attribution
) -> Callable[[Sequence[Columns]], tuple[np.ndarray, np.ndarray]]:
    """Least squares of all whitened rows at once, the left-out fold with its small weight."""

    def solve(blocks: Sequence[Columns]) -> tuple[np.ndarray, np.ndarray]:
        regression = found.regression
        for block in blocks:
            regression = regression.with_columns(block)
        tables = []
        weights = products.weights(OUT)
        for rows, noise, fold in zip(
            regression.extended, found.fit.noise_models, products.folds, strict=True
        ):
            table = np.zeros((len(rows), regression.total + 1))
            table[:, rows.columns] = rows.matrix
            table[:, -1] = rows.torque
            table = noise.standardized(table, rows.segments)
            tables.append(table * np.sqrt(np.where(fold < 0, 0.0, weights[fold]))[:, None])
        whole = np.vstack(tables)
        scale = np.linalg.norm(whole[:, :-1], axis=0)
        values = np.linalg.lstsq(whole[:, :-1] / scale, whole[:, -1], rcond=1e-12)[0] / scale
        energies = [float(np.sum((t[:, -1] - t[:, :-1] @ values) ** 2)) for t in tables]
        return values, np.array(energies)

    return solve


def test_transposed_whitening_gives_the_products_of_whitened_rows(found: Attribution) -> None:
    random = np.random.default_rng(3)
    for noise in found.fit.noise_models:
        segments = [slice(0, 4), slice(4, 60), slice(60, 200)]
        one, two = random.standard_normal((2, 200, 3))
        inner = noise.whiten(one, segments).T @ two
        np.testing.assert_allclose(one.T @ noise.whiten_adjoint(two, segments), inner, atol=1e-10)


def test_every_candidate_has_the_energies_and_coefficients_of_a_direct_fit(
    products: FoldProducts,
    menu: Menu,
    direct: Callable[[Sequence[Columns]], tuple[np.ndarray, np.ndarray]],
) -> None:
    model = FoldModel(products, OUT)
    _, before = direct([])
    np.testing.assert_allclose(model.energies(), before, rtol=1e-10)
    scores = model.scores()
    for entry in menu.entries:
        if entry.effect in NONPARAMETRIC:  # their columns depend on those of the model
            continue
        k = len(entry.shapes) // 2
        first = entry.columns.start + k * entry.width
        view = model.view_of_menu(first, entry.width)
        (coefficients,), energies = model.with_candidates([view])
        values, after = direct([entry.rows[k]])
        np.testing.assert_allclose(energies[0], after, rtol=1e-8)
        np.testing.assert_allclose(coefficients, values[-entry.width :], rtol=1e-6)
        starts, _ = menu.by_width[entry.width]
        score = scores[entry.width][0][list(starts).index(first)]
        assert score == pytest.approx(before.sum() - after.sum(), rel=1e-6, abs=1e-6)


def test_beside_accepted_effects_too(
    products: FoldProducts,
    menu: Menu,
    direct: Callable[[Sequence[Columns]], tuple[np.ndarray, np.ndarray]],
) -> None:
    one, coupled = (
        next(each for each in menu.entries if each.effect.name == name)
        for name in ("torque_saturation", "joint_coupling")
    )
    model = FoldModel(products, OUT)
    for key, entry in (("one", one), ("coupled", coupled)):
        model = model.beside(key, products.block(key, entry.rows[0]))
    third = next(each for each in menu.entries if each.effect.name == "load_dependent_friction")
    values, after = direct([one.rows[0], coupled.rows[0], third.rows[0]])
    views = [
        model.view_of_menu(third.columns.start, third.width),
        model.view(products.block("third", third.rows[0])),
    ]
    for coefficients, energies in zip(*model.with_candidates(views), strict=True):
        np.testing.assert_allclose(energies, after, rtol=1e-8)
        np.testing.assert_allclose(coefficients, values[-third.width :], rtol=1e-6)
    stack = products.stack("third", [third.rows[0]])
    scores, _ = model.scores_of(stack)
    assert scores[0] == pytest.approx(model.energies().sum() - after.sum(), rel=1e-6)


def test_an_effect_that_explains_everything_leaves_what_rounding_leaves(
    data: Baseline, found: Attribution, menu: Menu, products: FoldProducts
) -> None:
    """As in a simulation without noise: no digit of the energy is known, and it is not zero."""
    entry = next(each for each in menu.entries if each.effect.name == "joint_coupling")
    torque = {joint: columns.sum(axis=1) for joint, columns in entry.rows[0].items()}
    exact = Regression(
        tuple(
            replace(
                rows, torque=rows.matrix @ data.estimate.linear.values[rows.columns] + torque[joint]
            )
            for joint, rows in enumerate(found.regression.joints)
        ),
        found.regression.parameters,
    )
    quiet = (AutoregressiveModel(np.zeros(0), 1e-24),) * 2  # (1e-12 N m)², as noise_model has it
    values = exact.fit(quiet, steps=0).values
    noiseless = FoldProducts(exact, quiet, values, products.folds, menu)
    search = FoldSearch(data, operating_range(data), noiseless, noiseless)
    gains = {each.effect.name: each.gain for each in search.candidates(search.model(OUT), set())}
    # Sixteen digits of the energy: ln 10 of half the rows each.
    digits = gains["joint_coupling"] / (0.5 * np.log(10.0) * noiseless.rows.sum())
    assert 10.0 < digits < 16.0
    assert gains["joint_coupling"] == max(gains.values())
    losses = held_out_losses(noiseless, [], [entry.rows[0], menu.entries[0].rows[0]])
    assert included(losses) == {0}


def test_a_true_effect_is_chosen_without_every_fold(data: Baseline, found: Attribution) -> None:
    crossed = CrossFitting(data, found).choices(interleaved=False)
    (only,) = found.found
    assert all([each.key for each in fold] == [only.candidate.key] for fold in crossed.chosen)
    assert (
        crossed.times(only, found.found).words == f"{len(crossed.chosen)} of {len(crossed.chosen)}"
    )


def test_predictions_are_those_of_fits_without_the_fold(data: Baseline, found: Attribution) -> None:
    """With the shape of the full search in every fold, the stages are those of `held_out`."""
    (only,) = found.found
    crossed = CrossFitting(data, found).choices(interleaved=False)
    same = replace(
        crossed,
        chosen=tuple(
            tuple(
                replace(each, shape=only.candidate.shape, columns=only.candidate.columns)
                for each in fold
            )
            for fold in crossed.chosen
        ),
    )
    label = ["+stribeck[joint_2]"]
    made = same.held_out([only], label, [], None)
    expected = held_out(data, found.extended, found.fit, label, [])
    for stage, other in zip(made.residuals, expected.residuals, strict=True):
        for joint, (one, two) in enumerate(zip(stage, other, strict=True)):
            used = made.folds[joint] >= 0
            np.testing.assert_allclose(one[used], two[used], atol=1e-7)


class Elsewhere(Stribeck):
    """The torque of joint_2 as an effect of joint_1 on it."""

    name = "elsewhere"

    def places(self, joints: int) -> list[Place]:
        return [Place(0, 1)]

    def grid(self, place: Place, covered: OperatingRange) -> Sequence[StribeckShape]:
        return super().grid(Place(1), covered)

    def columns(self, motion: RobotMotion, place: Place, shape: StribeckShape) -> dict[int, Any]:
        return super().columns(motion, Place(1), shape)


class OfTheParameters(ErrorBeyondBase):
    """The torque of Stribeck friction as if it were a parameter error."""

    name = "of the parameters"
    place = Place(1)

    def places(self, joints: int) -> list[Place]:
        return [self.place]

    def grid(self, place: Place, covered: OperatingRange) -> list[Shape]:
        return list(Stribeck().grid(place, covered))

    def columns(self, motion: RobotMotion, place: Place, shape: Any) -> dict[int, Any]:
        return Stribeck().columns(motion, place, shape)


class Flexible(OfTheParameters, Nonparametric):
    """The same as a nonparametric function of another family."""

    name = "flexible"
    family = "position"


def test_a_set_may_hold_other_joints_parameters_and_nonparametric_functions(
    data: Baseline,
) -> None:
    _, joint, _, torque = SINGLE[0]
    catalogue: list[Effect] = [
        Stribeck(), Elsewhere(), OfTheParameters(), Flexible(), LoadDependentFriction()
    ]  # fmt: skip
    made = attribute(data, world(data, 5, joint, torque), catalogue)
    (only,) = CrossFitting(data, made).with_sets(made.found)
    names = {only.candidate.effect.name, *(e.effect.name for e, _ in only.indistinguishable_from)}
    assert names == {"stribeck", "elsewhere", "of the parameters", "flexible"}


def test_the_p_value_of_a_true_effect_is_as_small_as_the_draws_allow(
    data: Baseline, found: Attribution
) -> None:
    value, origin = CrossFitting(data, found).p_value(found.found[0], found.found[:0])
    assert value == pytest.approx(1.0 / 200.0)
    assert "199 recordings" in origin and "0.005" in origin


def test_by_chance_all_p_values_are_as_frequent(
    data: Baseline, menu: Menu, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Forty worlds without an effect, each with noise models of its own.

    With 39 draws, p-values are multiples of 1/40: they are as frequent as with more.
    """
    monkeypatch.setattr(settings, "NULL_DRAWS", 39)
    folds, _ = folds_of(data, ())
    found = []
    for seed in range(40):
        null: Regression = world(data, 100 + seed, pole=0.5)
        fit = null.fit()
        noise = null_noise(null, fit.noise_models, folds, seed)
        model = FoldModel(FoldProducts(null, fit.noise_models, fit.values, folds, menu, noise))
        found.append(p_value(largest_support(model), null_supports(model)))
    # Binomial with 40 draws: below 0.5 are 20 ± 3.2, below 0.1 are 4 ± 1.9.
    assert 10 <= np.sum(np.array(found) <= 0.5) <= 30
    assert np.sum(np.array(found) <= 0.1) <= 10
