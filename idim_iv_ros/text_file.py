"""Text that a user names: whole, of a bounded size, or one line on why not."""

import stat
from pathlib import Path

from idim_iv_ros.errors import UsageError


def read_text(path: Path, what: str, *, megabytes: float) -> str:
    """Read a UTF-8 file, with or without a byte order mark.

    A device or a pipe is refused before it is opened: it may never end, or never begin.

    Parameters
    ----------
    path
    what
        What is expected there, for the message: ``the trajectory``.
    megabytes
        The largest size that such a file has.

    Raises
    ------
    UsageError
        Missing, unreadable, no regular file, too large, or no text; one line with the path.
    """
    try:
        state = path.stat()
        if stat.S_ISDIR(state.st_mode):
            raise IsADirectoryError(0, "it is a folder")
        if not stat.S_ISREG(state.st_mode):
            raise OSError(0, "it is a device, a pipe or a socket; write it to a file first")
        with path.open("rb") as file:
            content = file.read(int(1e6 * megabytes) + 1)
        if len(content) > 1e6 * megabytes:
            raise OSError(0, f"it is larger than {megabytes:g} MB")
        return content.decode("utf-8-sig")
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not a text file"
        raise UsageError(f"{path}: cannot read {what}: {reason or error}") from error
