"""The two ways in which a request can fail, each with one line for the user, and a warning."""


class IdimError(Exception):
    """Something the user can act on: the message is one line (what, where, what to do)."""

    exit_status = 1


def one_line(error: BaseException) -> str:
    """Return class and text of an unexpected error in one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


class UsageError(IdimError):
    """The request is wrong: command line, configuration file, robot description, output folder."""

    exit_status = 2


class DataError(IdimError):
    """The recording or the model cannot support the answer that was asked for."""

    exit_status = 1


class ReportWarning(UserWarning):
    """A part of a report cannot be drawn or written; the numbers are complete all the same."""
