"""Standard deviations of an effect's numbers against the scatter over many worlds."""

import numpy as np
import pytest

from idim_iv_ros.gap.attribution import attribute
from idim_iv_ros.gap.baseline import Baseline, baseline
from idim_iv_ros.gap.effect_deviations import parameters_of
from idim_iv_ros.gap.effects.effect import Effect
from idim_iv_ros.gap.effects.friction_drift import FrictionDrift
from idim_iv_ros.gap.effects.nonlinear_viscous import NonlinearViscous
from idim_iv_ros.gap.effects.stribeck import Stribeck
from idim_iv_ros.gap.effects.torque_saturation import TorqueSaturation
from idim_iv_ros.gap.structural_causes import effect_parameters, named_model
from tests.estimation.test_simulated_arms import recorded
from tests.gap.test_attribution import Torque, world
from tests.simulated_arms import arm2

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
    arm = arm2(seconds=24.0)
    return baseline([recorded(arm, 1)], arm.configuration)


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
