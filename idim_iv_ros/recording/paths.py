"""Whether there is something under a name that a user gave."""

from pathlib import Path

from idim_iv_ros.errors import UsageError


def is_file(path: Path) -> bool:
    """Whether `path` is a file; see `is_there`."""
    return is_there(path) and path.is_file()


def is_there(path: Path) -> bool:
    """Whether there is a file or folder `path`.

    Raises
    ------
    UsageError
        The name is no name for this system (too long), or a folder on the way may not be entered.
    """
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    except (OSError, ValueError) as error:
        shown = str(path) if len(str(path)) < 80 else f"{str(path)[:60]}…"
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise UsageError(f"{shown}: cannot be read: {reason}") from error
    return True
