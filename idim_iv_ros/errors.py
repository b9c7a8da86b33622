"""The two ways in which a request can fail, each with one line for the user, and warnings."""

import os
import warnings
from collections.abc import Sequence


class IdimError(Exception):
    """Something the user can act on: the message is one line (what, where, what to do)."""

    exit_status = 1


def one_line(error: BaseException) -> str:
    """Return class and text of an unexpected error in one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def first_of(names: Sequence[str], most: int) -> str:
    """Return names for a sentence: the first of them, and how many more there are."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


class UsageError(IdimError):
    """The request is wrong: command line, configuration file, robot description, output folder."""

    exit_status = 2


class DataError(IdimError):
    """The recording or the model cannot support the answer that was asked for."""


class ReportWarning(UserWarning):
    """A part of a report cannot be drawn or written; the numbers are complete all the same."""


def silence_foreign_warnings() -> None:
    """Show no Python warning of other libraries from here on, unless someone asked for it.

    The filter comes after all others: ``python -W``, ``PYTHONWARNINGS`` and a test's own filters
    hold, and with ``IDIM_IV_TRACEBACK`` everything is shown.
    """
    if not os.environ.get("IDIM_IV_TRACEBACK"):
        warnings.simplefilter("ignore", append=True)
