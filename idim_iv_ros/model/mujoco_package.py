"""MuJoCo, which only MJCF files and replays need: loaded when it is asked for."""

from importlib import import_module
from typing import Any

from idim_iv_ros.errors import UsageError


def load_mujoco(needed_for: str) -> Any:
    """Return the module `mujoco`.

    Parameters
    ----------
    needed_for
        What needs it, in words: the beginning of the message.

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
