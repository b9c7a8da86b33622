"""Files that a request names stay inside the folders that the node was given."""

import stat
from collections.abc import Iterable
from pathlib import Path

from idim_iv_ros.errors import UsageError

_LONGEST = 1000


def confined(folder: Path, name: str, what: str) -> Path:
    """Return the file or folder that a request names, links resolved.

    Parameters
    ----------
    folder
        What is named lies in here.
    name
        Relative to `folder`, or absolute and inside it.
    what
        The parameter that holds the folder, for the message.

    Raises
    ------
    UsageError
        An empty name, one with ``..``, or one that leads out of the folder, also by a link.
    """
    if len(name) > _LONGEST:
        raise UsageError(f"{what}: a name of {len(name)} characters is too long")
    if not name or "\0" in name:
        raise UsageError(f"{name!r} names no file in {what}")
    if ".." in Path(name).parts:
        raise UsageError(f"{name}: '..' is not allowed; name a file in {what}")
    path = _resolved(folder / name, name)
    if not path.is_relative_to(_resolved(folder, what)):
        raise UsageError(f"{name}: leads out of {what}")
    return path


def confined_bag(folder: Path, name: str) -> tuple[Path, int]:
    """Return a bag that a request names, and its size in bytes.

    Raises
    ------
    UsageError
        As `confined`; or the bag, or a file of it, does not exist, leads out of the folder, or is
        no regular file.
    """
    path = confined(folder, name, "bag_directory")
    root = _resolved(folder, "bag_directory")
    try:
        files: Iterable[Path] = path.iterdir() if path.is_dir() else [path]
        return path, sum(_size(file, root, name) for file in files)
    except FileNotFoundError as error:
        raise UsageError(f"{name}: no such bag in bag_directory") from error
    except OSError as error:
        raise UsageError(f"{name}: cannot be read: {error.strerror or error}") from error


def _size(file: Path, root: Path, name: str) -> int:
    if not _resolved(file, name).is_relative_to(root):
        raise UsageError(f"{name}: its file {file.name} leads out of bag_directory")
    status = file.stat()
    if stat.S_ISDIR(status.st_mode):
        return 0  # no part of a bag: it is never read
    if not stat.S_ISREG(status.st_mode):
        raise UsageError(f"{name}: its file {file.name} is no regular file")
    return status.st_size


def _resolved(path: Path, name: str) -> Path:
    try:
        return path.resolve()
    except (OSError, RuntimeError) as error:  # too long, or a link to itself
        raise UsageError(f"{name}: no such file") from error
