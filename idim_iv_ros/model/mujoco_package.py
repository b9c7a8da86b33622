"""MuJoCo, which only MJCF files and replays need: loaded when it is asked for."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

import numpy as np

from idim_iv_ros.errors import UsageError

# What MuJoCo says of a model, and what is meant; any other sentence of it is kept.
_PREFIXES = re.compile(r"^((XML )?Error: |Schema violation: |ParseXML: )+")
_PLACE = re.compile(r"\s*Element (?:name )?'(?P<name>[^']*)'(?:, id \d+)?, line (?P<line>\d+)\s*$")
_NO_XML = re.compile(r"XML parse error.*Line number=(?P<line>\d+)", re.DOTALL)
_SENTENCES = {
    "mass and inertia of moving bodies must be larger than mjMINVAL": (
        "a body that moves needs a mass and moments of inertia above zero"
    ),
    "inertia must satisfy A + B >= C; use 'balanceinertia' to fix": (
        "no body has such moments of inertia: one is larger than the sum of the others"
    ),
}


def load_mujoco(needed_for: str) -> Any:
    """Return the module `mujoco`.

    - `needed_for`: what needs it, in words: the beginning of the message

    Raises
    ------
    UsageError
        It is not installed, or cannot be loaded.
    """
    try:
        return import_module("mujoco")
    except ImportError as error:
        raise UsageError(
            f"{needed_for} needs MuJoCo: pip install 'idim-iv-ros[mujoco]' ({error})"
        ) from error


def set_first(element: Any, name: str, value: float) -> None:
    """Set a number of an element that newer versions of MuJoCo hold as that of a polynomial."""
    more = len(np.atleast_1d(getattr(element, name))) - 1
    setattr(element, name, [value, *[0.0] * more] if more else value)


@contextmanager
def mujoco_warnings() -> Iterator[list[str]]:
    """Collect MuJoCo's warnings; else it writes them to MUJOCO_LOG.TXT in the present folder."""
    mujoco, warned = import_module("mujoco"), list[str]()
    mujoco.set_mju_user_warning(warned.append)
    try:
        yield warned
    finally:
        mujoco.set_mju_user_warning(None)


@contextmanager
def mujoco_reads(path: object) -> Iterator[None]:
    """Say in one line of a file what MuJoCo says in several, or only warns of.

    Raises
    ------
    UsageError
        MuJoCo refuses the file, or a number in it is NaN.
    """
    problem = ""
    with mujoco_warnings() as warned:
        try:
            yield
        except UsageError:
            raise
        except Exception as error:  # ValueError, FatalError and others
            problem = str(error)
    if any("NaN" in text for text in warned):
        raise UsageError(f"{path}: a number in it is NaN")
    if problem:
        raise UsageError(f"{path}{_in_words(problem)}")


def _in_words(problem: str) -> str:
    """Where MuJoCo found what, behind the name of the file."""
    broken = _NO_XML.search(problem)
    if broken:
        return f", line {broken['line']}: not XML"
    place = _PLACE.search(problem)
    where = ""
    if place:
        name = f" ({place['name']})" if place["name"] else ""
        where, problem = f", line {place['line']}{name}", problem[: place.start()]
    sentence = _PREFIXES.sub("", " ".join(problem.split()))
    return f"{where}: {_SENTENCES.get(sentence, sentence)}"
