"""Every number of every effect says in words what it is."""

import numpy as np
import pytest

from idim_iv_ros.diagnosis.result import EffectParameter
from idim_iv_ros.effects.cause import surest
from idim_iv_ros.effects.controller_mismatch import ControllerMismatch
from idim_iv_ros.effects.parametric_effect import Change, Estimated, ParameterSpace
from idim_iv_ros.effects.registry import parameter_words
from idim_iv_ros.effects.torque_gain import TorqueGain
from tests.diagnosis.test_effects import UNITS


@pytest.mark.parametrize("effect", [*UNITS, "controller_mismatch"])
def test_numbers_of_structural_effects_have_words(effect: str) -> None:
    of_law = [spec.name for spec in ControllerMismatch.specs]
    names = of_law if effect == ControllerMismatch.name else list(UNITS[effect])
    words = [parameter_words(effect, name) for name in names]
    assert len(set(words)) == len(names)  # in a table each has its own row
    for name, word in zip(names, words, strict=True):
        assert "_" not in word
        assert word != name.replace("_", " ") or name in ("time_constant", "wave_number_1")


def test_a_gain_of_1_25_is_a_factor_of_1_25() -> None:
    """Recorded torque 0.8 of the actual one: the actual is 1.25 times the recorded."""
    nothing: ParameterSpace = None  # type: ignore[assignment]
    estimates = [Estimated(Change("recorded_more", "", np.zeros(1)), 0.8 - 1.0, 0.01)]
    (only,) = TorqueGain().parameters(nothing, 0, estimates).items()
    name, number = only
    assert parameter_words("torque_gain", name) == "actual torque over recorded torque"
    assert number.value == pytest.approx(1.25)
    assert number.std == pytest.approx(0.01 / 0.8**2)


@pytest.mark.parametrize(
    ("effect", "name", "words"),
    [
        ("link_inertia", "change_of_MX3", "change of MX3"),
        ("link_inertia", "change_of_base_MX3", "change of MX3 (grouped)"),
        ("payload", "inertia_xy", "moment of inertia xy about the link's frame"),
        ("position_ripple", "sine_12", "torque with the sine 12"),
    ],
)
def test_names_that_are_made_have_words(effect: str, name: str, words: str) -> None:
    assert parameter_words(effect, name) == words


def test_a_mass_comes_first_however_sure_moments_of_inertia_are() -> None:
    numbers = {
        **{f"inertia_{axes}": EffectParameter(1.0, 0.01, "kg m²") for axes in ("xx", "yy", "zz")},
        "moment_x": EffectParameter(0.2, 0.01, "kg m"),
        "mass": EffectParameter(1.5, 0.5, "kg"),
    }
    assert list(surest(numbers, 3)) == ["mass", "inertia_xx", "inertia_yy"]
