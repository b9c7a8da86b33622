"""Functions that meet any number or text of a user: they answer, or refuse in one line."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from idim_iv_ros.errors import IdimError
from idim_iv_ros.excitation.fourier import FourierBasis
from idim_iv_ros.report import numerals
from idim_iv_ros.simulators.effects_file import read_effects
from tests.gap_files import gap_content

_ANY = st.one_of(st.none(), st.floats())
# The same examples in every run: a failure is of the change that is tested, not of the day.
_SAME = settings(
    derandomize=True,
    deadline=None,
    max_examples=60,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


@_SAME
@given(_ANY, _ANY)
def test_every_number_can_be_written_beside_any_uncertainty(value, std) -> None:
    texts = [
        *numerals.measured(value, std),
        numerals.with_digits_of(value, std),
        numerals.number(value),
        numerals.percent(value),
        numerals.p_value(value),
        numerals.with_unit(value, "N m"),
        numerals.exact(value, "N m"),
    ]
    finite = value is not None and math.isfinite(value)
    assert (texts[0] == numerals.MISSING) is not finite
    assert all("nan" not in text and "inf" not in text and len(text) < 60 for text in texts)


def _refused_or_read(read, path: Path) -> None:
    try:
        read(path)
    except IdimError as error:
        assert str(path) in str(error)
        assert "\n" not in str(error)


_JSON = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5)),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3), st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=8,
)


@_SAME
@given(causes=_JSON, parameters=_JSON, value=_JSON)
def test_any_json_is_a_diagnosis_or_one_line(causes, parameters, value, tmp_path: Path) -> None:
    path = tmp_path / "gap.json"
    for document in (
        {"causes": causes, "extended_parameters": parameters},
        gap_content(
            {"effect": "stribeck", "joint": causes, "parameters": {"level": value}},
            parameters={"YY1": value},
        ),
    ):
        path.write_text(json.dumps({**gap_content(), **document}))
        _refused_or_read(read_effects, path)
    by_hand = {"base_parameters": parameters, "effects": causes}
    one = {"effects": [{"effect": "stribeck", "joint": causes, "parameters": {"level": value}}]}
    for document in (by_hand, one):
        path.write_text(json.dumps({"format": "idim_iv_ros/effects/1", **document}))
        _refused_or_read(read_effects, path)


@pytest.mark.parametrize("samples", [1, 1999, 2000, 2001, 5000])
def test_a_motion_in_blocks_is_the_sum_of_its_shapes(samples: int) -> None:
    basis = FourierBasis(3.0, 7)
    coefficients = np.random.default_rng(1).normal(size=(basis.size, 2))
    time = np.arange(samples) / 1000.0
    for block, shape in zip(basis.motion(time, coefficients), basis.shapes(time), strict=True):
        np.testing.assert_allclose(block, shape @ coefficients, rtol=0.0, atol=1e-11)
