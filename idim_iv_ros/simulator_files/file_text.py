"""Text of new files: from templates, and numbers and elements of XML."""

import math
from typing import Any
from xml.etree import ElementTree

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from idim_iv_ros.types import FloatArray

_TEMPLATES = Environment(
    loader=PackageLoader("idim_iv_ros.simulator_files"),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)


def file_text(template: str, **shown: object) -> str:
    """Return the text of a file from its template under ``templates/``."""
    return _TEMPLATES.get_template(f"{template}.j2").render(shown)


def number_text(value: float) -> str:
    """With more digits than any interval has a use for, and no rounding of sums."""
    return f"{float(value) + 0.0:.8g}"


def numbers_text(values: FloatArray) -> str:
    """Several of one kind, with the digits that the largest has."""
    largest = float(np.abs(values).max())
    digits = 7 - math.floor(math.log10(largest)) if largest > 0.0 else 0
    return " ".join(number_text(round(float(value), digits)) for value in values)


def comment(text: str) -> Any:
    """A text as an XML comment."""
    return ElementTree.Comment(f" {text.replace('--', '- -')} ")
