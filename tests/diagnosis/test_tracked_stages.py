"""The simulated motion of each stage where an effect cannot be simulated."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.tracking import tracked_stages
from idim_iv_ros.effects.cause import EffectParameter
from idim_iv_ros.effects.effect import Place


def effect_of(name: str, **numbers: float) -> Any:
    """A cause whose effect has these numbers, whatever its coefficients."""
    parameters = {key: EffectParameter(value, None, "") for key, value in numbers.items()}
    effect = SimpleNamespace(name=name, parameters=lambda *_: parameters)
    return SimpleNamespace(term=SimpleNamespace(effect=effect, place=Place(0), shape=None))


def test_effects_that_cannot_be_simulated_do_not_end_the_simulation(data: Baseline) -> None:
    fit = SimpleNamespace(values=data.estimate.linear.values, coefficients=np.zeros(2))
    effects = (effect_of("no such effect"), effect_of("spring", linear=40.0))
    explanation: Any = SimpleNamespace(
        effects=effects, fits=[fit] * 3, fit=fit, block=lambda number: slice(number, number + 1)
    )
    _, refit, unknown, spring = tracked_stages(data, explanation)
    assert (refit.note, refit.caveat) == ("", "")
    assert (unknown.note, unknown.rms) == ("", refit.rms)
    assert "no such effect" in unknown.caveat
    assert (spring.note, spring.caveat) == ("", "")
    assert spring.rms is not None and refit.rms is not None
    assert spring.rms["joint_1"] > 2.0 * refit.rms["joint_1"]
