"""Functions that meet any number or text of a user: they answer, or refuse in one line."""

import math
import sys

import pytest

from idim_iv_ros.report import numerals

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
