"""What a value of the configuration may be: finite, and of a size that robots have."""

from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, Field


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError("holds characters that cannot be shown")
    return text


def _not_zero(value: float) -> float:
    if abs(value) < 1e-12:
        raise ValueError("must not be zero")
    return value


# No quantity of a robot is larger in SI units; products of larger ones overflow.
_LARGEST = 1e9
Number = Annotated[float, Field(ge=-_LARGEST, le=_LARGEST)]
NotNegative = Annotated[float, Field(ge=0.0, le=_LARGEST)]
Positive = Annotated[float, Field(ge=1e-6, le=_LARGEST)]
NotZero = Annotated[Number, AfterValidator(_not_zero)]
# No recorder of a robot is faster than 100 kHz, and no control of its joints than 20 kHz; what is
# slower than 0.01 Hz is no motion.
Frequency = Annotated[float, Field(ge=0.01, le=1e5)]
Rate = Annotated[float, Field(ge=0.01, le=1e5)]
Period = Annotated[float, Field(ge=5e-5, le=10.0)]
Delay = Annotated[float, Field(ge=0.0, le=1.0)]
Acceleration = Annotated[float, Field(ge=-1000.0, le=1000.0)]
Fraction = Annotated[float, Field(gt=0.0, lt=1.0)]
Name = Annotated[str, Field(min_length=1, max_length=255), AfterValidator(_printable)]
# Read from YAML as text, in any mode of pydantic.
FilePath = Annotated[Path, Field(strict=False)]
Vector = list[Number]
Matrix = list[list[Number]]
Levels = list[NotNegative]
Gains = list[NotNegative]
PositiveValues = list[Positive]
