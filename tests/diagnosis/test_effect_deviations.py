"""Standard deviations of an effect's numbers against the scatter over many worlds."""

from dataclasses import replace

import numpy as np
import pytest

from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.structural.attribution import attribute
from idim_iv_ros.diagnosis.structural.causes import built_model, effect_parameters, named_model
from idim_iv_ros.diagnosis.structural.confirmation import sized
from idim_iv_ros.diagnosis.structural.deviations import differs_from_nothing, parameters_of
from idim_iv_ros.effects.effect import Effect
from idim_iv_ros.effects.friction_drift import FrictionDrift
from idim_iv_ros.effects.motion import RobotMotion
from idim_iv_ros.effects.nonlinear_viscous import NonlinearViscous
from idim_iv_ros.effects.spring import Spring
from idim_iv_ros.effects.stribeck import Stribeck
from idim_iv_ros.effects.torque_saturation import TorqueSaturation
from idim_iv_ros.types import FloatArray
from tests.diagnosis.simulated_sessions import arm2_session
from tests.diagnosis.test_attribution import Torque, world

# Effect, joint, torque, its true numbers.
WORLDS: list[tuple[Effect, int, Torque, dict[str, float]]] = [
    (Stribeck(), 1,
     lambda m: 0.5 * m.slip[:, 1] * np.exp(-((m.velocity[:, 1] / 0.15) ** 2)),
     {"excess": 0.5, "speed": 0.15, "exponent": 2.0}),
    (NonlinearViscous(), 1, lambda m: 0.3 * abs(m.velocity[:, 1]) ** 1.7 * m.slip[:, 1],
     {"coefficient": 0.3, "power": 1.7}),
    (TorqueSaturation(), 0,
     lambda m: 0.4 * np.sign(m.torque[:, 0]) * np.maximum(abs(m.torque[:, 0]) - 12.0, 0.0),
     {"knee": 12.0, "slope": 1.0 / 1.4}),
    (FrictionDrift(), 1, lambda m: 0.5 * np.exp(-m.time / 5.0) * m.slip[:, 1],
     {"time_constant": 5.0, "coulomb": 0.5}),
]  # fmt: skip
SEEDS = range(50, 58)


@pytest.fixture(scope="module")
def data() -> Baseline:
    return arm2_session(24.0)


@pytest.mark.parametrize(
    ("effect", "joint", "torque", "truth"), WORLDS, ids=[each[0].name for each in WORLDS]
)
def test_intervals_cover_the_truth_about_as_often_as_they_say(
    data: Baseline, effect: Effect, joint: int, torque: Torque, truth: dict[str, float]
) -> None:
    errors: dict[str, list[float]] = {name: [] for name in truth}
    for seed in SEEDS:
        model = named_model(attribute(data, world(data, seed, joint, torque), [effect]))
        (found,) = model.found
        numbers = parameters_of(data, model.regression, model.fit, found.candidate, 0)
        held = effect_parameters(model, 0)
        for name, value in truth.items():
            std = numbers[name].std
            assert std is not None
            assert numbers[name].value == held[name].value
            errors[name].append((numbers[name].value - value) / std)
    for name, each in errors.items():
        assert 0.3 < np.sqrt(np.mean(np.square(each))) < 1.7, name


def test_an_effect_that_is_there_differs_from_nothing_and_one_that_is_not_does_not(
    data: Baseline,
) -> None:
    effect, joint, torque, _ = WORLDS[1]
    model = named_model(attribute(data, world(data, 50, joint, torque), [effect]))
    candidate = model.found[0].candidate
    assert differs_from_nothing(data, model.regression, model.fit, candidate, 0)
    refused = 0
    for seed in SEEDS:
        empty = world(data, seed, joint, lambda m: 0.0 * m.time).with_columns(candidate.columns)
        refused += not differs_from_nothing(data, empty, empty.fit(), candidate, 0)
    assert refused >= len(SEEDS) - 2  # by chance one in twenty is not


def test_an_effect_whose_numbers_may_each_be_zero_is_not_confirmed(
    data: Baseline, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Twice the same column: together it fits well, and neither coefficient is known."""
    effect, joint, torque, _ = WORLDS[0]
    attribution = attribute(data, world(data, 50, joint, torque), [effect])
    (found,) = attribution.found
    random = np.random.default_rng(1)
    twice = {
        j: np.column_stack([rows[:, 0], rows[:, 0] + 1e-5 * random.standard_normal(len(rows))])
        for j, rows in found.candidate.columns.items()
    }
    same = replace(found, candidate=replace(found.candidate, columns=twice))
    monkeypatch.setattr(Stribeck, "free_shape", False)
    for each, kept in ((found, 1), (same, 0)):
        model = built_model(attribution, [each], [])
        assert model.fits[-1].log_likelihood > model.fits[0].log_likelihood + 50.0
        assert len(sized(data, model)) == kept


def test_a_torque_that_is_sure_differs_from_nothing_where_its_numbers_are_not(
    data: Baseline,
) -> None:
    """Viscous friction of a power near one: what the model's own takes up leaves no number."""
    effect = NonlinearViscous()

    def torque(m: RobotMotion) -> FloatArray:
        return np.asarray(4.0 * abs(m.velocity[:, 1]) ** 1.15 * m.slip[:, 1])

    model = named_model(attribute(data, world(data, 60, 1, torque), [effect]))
    (found,) = model.found
    numbers = parameters_of(data, model.regression, model.fit, found.candidate, 0)
    coefficient = numbers["coefficient"]
    assert coefficient.std is not None
    assert abs(coefficient.value) < 1.96 * coefficient.std
    assert found.candidate.gain > 20.0
    assert differs_from_nothing(data, model.regression, model.fit, found.candidate, 0)


def test_a_bend_that_is_wide_is_a_spring_all_the_same(data: Baseline) -> None:
    effect = Spring()

    def torque(m: RobotMotion) -> FloatArray:
        return np.asarray(3.0 * m.position[:, 0] ** 3)

    model = named_model(attribute(data, world(data, 61, 0, torque), [effect]))
    (found,) = model.found
    assert differs_from_nothing(data, model.regression, model.fit, found.candidate, 0)
