"""Functions that meet any number or text of a user: they answer, or refuse in one line."""

import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest

from idim_iv_ros.errors import IdimError
from idim_iv_ros.excitation.fourier import FourierBasis
from idim_iv_ros.report import numerals
from idim_iv_ros.simulators.effects_file import read_effects
from tests.gap_files import gap_content

_SIZES = [
    *(
        0.0,
        5e-324,
        sys.float_info.min,
        1e-300,
        1.1e-16,
        1e-9,
        0.00123,
        0.05,
        0.0999,
        0.5,
        1 - 2**-53,
    ),
    *(1 - 2**-53, 1.0, 9.995, 99.95, 123.456, 999.5, 12345.6789, 1e7, 2.0**53 + 2, 1e22, 1e300),
    *(sys.float_info.max, math.inf, math.nan),
]
_NUMBERS = [None, *_SIZES, *(-size for size in _SIZES)]


@pytest.mark.parametrize("value", _NUMBERS)
def test_every_number_can_be_written_beside_any_uncertainty(value: float | None) -> None:
    for std in _NUMBERS:
        require_written(value, std)


def require_written(value: float | None, std: float | None) -> None:
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


_PLAIN = [None, True, 0, -1, 2**70, 10**400, 1.5, 1e300, math.nan, -math.inf, "", "é\0\n", "YY1"]
_JSON = [
    *_PLAIN,
    *([], [[[]]], [None, 1], [{}], ["joint_1", math.nan], {}, {"": None}, {"YY1": {}}),
    *({"YY1": value} for value in _PLAIN),
    *({"YY1": {"value": value, "std": value, "unit": value}} for value in _PLAIN),
    *([{"effect": value, "joint": value, "parameters": value}] for value in _PLAIN),
]


@pytest.mark.parametrize("shift", range(3))
def test_any_json_is_a_diagnosis_or_one_line(shift: int, tmp_path: Path) -> None:
    """Three values at once, each of them in every place."""
    for place in range(len(_JSON)):
        others = ((place + step * shift) % len(_JSON) for step in (1, -6))
        _require_read_or_refused(_JSON[place], *(_JSON[other] for other in others), tmp_path)


def _require_read_or_refused(causes, parameters, value, folder: Path) -> None:
    path = folder / "gap.json"
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
