"""Numbers as text, with as many digits as their uncertainty leaves."""

import math
from collections.abc import Sequence
from typing import TypeGuard

MISSING = "–"
THIN = "\N{NARROW NO-BREAK SPACE}"
MINUS = "\N{MINUS SIGN}"
INTERVAL = 1.96

_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_SMALLEST, _LARGEST = 1e-4, 1e6
_DIGITS = 15  # that a float holds
_TINIEST = 1e-300  # a σ below is none: powers of ten end soon after


def is_number(value: float | None) -> TypeGuard[float]:
    """Return whether a value is a finite number."""
    return value is not None and math.isfinite(value)


def is_interval(ends: tuple[float | None, float | None] | None) -> TypeGuard[tuple[float, float]]:
    """Return whether both ends of an interval are finite numbers."""
    return ends is not None and all(map(is_number, ends))


def number(value: float | None, digits: int = 3) -> str:
    """Return a number with `digits` significant digits; a dash where there is none."""
    if not is_number(value):
        return MISSING
    if value == 0.0:
        return "0"
    if not _SMALLEST <= abs(value) < _LARGEST:
        mantissa, _, exponent = f"{value:.{digits - 1}e}".partition("e")
        return _power(mantissa, int(exponent))
    return fixed(value, digits - 1 - _exponent(value, digits))


def round_number(value: float, digits: int = 3) -> str:
    """Return a number without trailing zeros: a bound or a tick, not a measurement."""
    text = number(value, digits)
    return text.rstrip("0").rstrip(".") if "." in text and "·" not in text else text


def fixed(value: float, decimals: int) -> str:
    """Return a number with that many decimals; a negative count rounds digits before the point."""
    rounded = round(value, decimals)
    # Four digits stand together, longer numbers in groups of three (ISO 80000-1).
    group = "," if abs(rounded) >= 1e4 else ""
    text = f"{rounded:{group}.{max(0, decimals)}f}".replace(",", THIN)
    if not any(digit in text for digit in "123456789"):
        text = text.lstrip("-")
    return text.replace("-", MINUS)


def exact(value: float | None, unit: str) -> str:
    """Return a number that was set, not measured, with up to six digits and its unit."""
    if not is_number(value):
        return MISSING
    return f"{value:.6g}".replace("-", MINUS) + f"{THIN}{unit}"


def count(value: int) -> str:
    """Return a whole number with its thousands separated."""
    return fixed(float(value), 0)


def plural(number_of: int, what: str) -> str:
    """Return a count with a noun: “1 bag”, “3 bags”."""
    return f"{count(number_of)} {what}{'' if number_of == 1 else 's'}"


def measured(value: float | None, std: float | None) -> tuple[str, str]:
    """Return a value and the half-width of its 95 % interval, rounded to the same digit.

    The half-width is 1.96 σ with two significant digits; it is empty where there is no σ.
    """
    if not is_number(value):
        return MISSING, ""
    half = 0.0 if std is None else INTERVAL * std
    if not _TINIEST < half < math.inf:
        return number(value, 4), ""
    largest = max(abs(value), half)
    decimals = 1 - _exponent(half, 2)
    if decimals + math.floor(math.log10(largest)) >= _DIGITS:
        return number(value, _DIGITS), f"±{THIN}{number(half, 2)}"
    if _SMALLEST <= largest < _LARGEST:
        return fixed(value, decimals), f"±{THIN}{fixed(half, decimals)}"
    exponent = math.floor(math.log10(largest))
    scale = 10.0**exponent
    decimals = max(0, decimals + exponent)
    text, width = (_power(fixed(of / scale, decimals), exponent) for of in (value, half))
    return text, f"±{THIN}{width}"


def with_interval(value: float | None, std: float | None, unit: str = "") -> str:
    """Return a value with the half-width of its 95 % interval and its unit, if known."""
    return " ".join(filter(None, (*measured(value, std), unit)))


def with_digits_of(value: float | None, std: float | None) -> str:
    """Return a value with the digits that an estimate with standard deviation `std` has."""
    return "0" if value == 0.0 else measured(value, std)[0]


def percent(value: float | None, digits: int = 2) -> str:
    """Return a share given in percent, with the percent sign."""
    if not is_number(value):
        return MISSING
    if abs(value) >= 1000.0:
        return f"> 1000{THIN}%" if value > 0 else f"< {MINUS}1000{THIN}%"
    return f"{number(value, digits if abs(value) < 100.0 else 3)}{THIN}%"


def share(value: float | None, digits: int = 2) -> str:
    """Return a share given as a fraction of one, in percent."""
    return percent(None if value is None else 100.0 * value, digits)


def p_value(value: float | None) -> str:
    """Return a p-value; “< 0.0001” below that."""
    if not is_number(value):
        return MISSING
    return "<\N{NO-BREAK SPACE}0.0001" if value < 1e-4 else number(value, 2)


def p_equals(value: float | None) -> str:
    """Return a p-value behind its relation, to write after “p”: “= 0.012”, “< 0.0001”."""
    text = p_value(value)
    return text if text.startswith("<") else f"= {text}"


def with_unit(value: float | None, unit: str, digits: int = 3) -> str:
    """Return a number with its unit."""
    text = number(value, digits)
    return text if text == MISSING else f"{text}{THIN}{unit}"


def sentence(text: str, names: Sequence[str] = ()) -> str:
    """Return text as a sentence: with a capital (unless it starts with a name) and a full stop."""
    if not any(text.startswith(name) for name in names):
        text = text[:1].upper() + text[1:]
    return text if text.endswith((".", "!", "?")) else f"{text}."


def _exponent(value: float, digits: int) -> int:
    """Return the exponent of ten of the leading digit after rounding to `digits` digits."""
    return int(f"{abs(value):.{digits - 1}e}".partition("e")[2])


def _power(mantissa: str, exponent: int) -> str:
    return f"{mantissa.replace('-', MINUS)}·10{str(exponent).translate(_SUPERSCRIPT)}"
