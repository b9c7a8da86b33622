"""MuJoCo, which only MJCF files and replays need: loaded when it is asked for."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

import numpy as np

from idim_iv_ros.errors import UsageError

_PREFIXES = re.compile(r"^((XML )?Error: |Schema violation: |ParseXML: )+")


def load_mujoco(needed_for: str) -> Any:
    """Return the module `mujoco`; `needed_for` is what needs it, in words.

    Raises UsageError: it is not installed, or cannot be loaded.
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

    Raises UsageError: MuJoCo refuses the file, or a number in it is NaN.
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
        sentence = _PREFIXES.sub("", " ".join(problem.split()))
        raise UsageError(f"{path}: {sentence}")
