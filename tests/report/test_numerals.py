import pytest

from idim_iv_ros.report.numerals import (
    MISSING,
    count,
    exact,
    measured,
    number,
    p_value,
    percent,
    with_digits_of,
)

T = "\N{NARROW NO-BREAK SPACE}"


@pytest.mark.parametrize(
    ("value", "std", "text", "half"),
    [
        (1.248637, 0.01625, "1.249", f"±{T}0.032"),
        (-0.0213456, 0.00427, "−0.0213", f"±{T}0.0084"),
        (95.10887, 0.05, "95.109", f"±{T}0.098"),
        (12345.6, 510.0, f"12{T}300", f"±{T}1000"),
        (0.0499, 0.0508, "0.05", f"±{T}0.10"),
        (2.34e-6, 1.1e-7, "2.34·10⁻⁶", f"±{T}0.22·10⁻⁶"),
        (3.2e7, 4e5, "3.200·10⁷", f"±{T}0.078·10⁷"),
        (0.00001, 0.5, "0.00", f"±{T}0.98"),
        (1.23456, 0.0, "1.235", ""),
        (1.23456, None, "1.235", ""),
        (float("nan"), 1.0, MISSING, ""),
    ],
)
def test_two_digits_of_the_interval_set_the_digits_of_the_value(value, std, text, half) -> None:
    assert measured(value, std) == (text, half)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (3.14159, "3.14"),
        (-2.0, "−2.00"),
        (187.34, "187"),
        (9.999, "10.0"),
        (43210.0, f"43{T}200"),
        (1.5e9, "1.50·10⁹"),
        (2.4e-7, "2.40·10⁻⁷"),
        (9.9996e-7, "1.00·10⁻⁶"),
        (None, MISSING),
        (float("inf"), MISSING),
    ],
)
def test_a_number_has_three_digits(value: float | None, text: str) -> None:
    assert number(value) == text


def test_another_estimate_is_rounded_like_the_estimate_beside_it() -> None:
    assert with_digits_of(1.23456, 0.01) == "1.235"
    assert with_digits_of(0.0, 0.01) == "0"
    assert with_digits_of(None, 0.01) == MISSING


def test_counts_are_grouped_from_five_digits_on() -> None:
    assert count(4761) == "4761"
    assert count(90001) == f"90{T}001"


def test_settings_keep_just_the_digits_they_were_given_with() -> None:
    assert exact(50.0, "Hz") == f"50{T}Hz"
    assert exact(166.6666667, "Hz") == f"166.667{T}Hz"


def test_a_tiny_p_value_is_only_called_small() -> None:
    assert p_value(3e-88) == "<\N{NO-BREAK SPACE}0.0001"
    assert p_value(0.0314) == "0.031"
    assert p_value(None) == MISSING


def test_a_share_beyond_measure_is_only_called_large() -> None:
    assert percent(132.4) == f"132{T}%"
    assert percent(5e4) == f"> 1000{T}%"
