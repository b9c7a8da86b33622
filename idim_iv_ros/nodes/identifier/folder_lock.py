"""The output directory of an identifier is locked: two would overwrite one history."""

import fcntl
import os
from pathlib import Path

from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import require_folder_place


class FolderLock:
    """A folder that one process has to itself, however it ends: the system releases the lock.

    Parameters
    ----------
    folder : Path
        Made if it is not there. Where it cannot be locked, as on some network disks, nothing is
        refused.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._open: int | None = None

    def take(self) -> None:
        """Have the folder from now on.

        Raises
        ------
        UsageError
            It cannot be written, or another identifier has it.
        """
        if self._open is not None:
            return
        try:
            require_folder_place(self._folder)
            self._folder.mkdir(parents=True, exist_ok=True)
            folder = os.open(self._folder, os.O_RDONLY)
        except (OSError, UsageError) as error:
            raise UsageError(f"parameter output_directory: {error}") from error
        try:
            fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            os.close(folder)
            raise UsageError(
                f"parameter output_directory: another identifier writes into {self._folder}; give "
                "each one a folder of its own"
            ) from error
        except OSError:
            os.close(folder)
            return
        self._open = folder

    def release(self) -> None:
        """Let others have it."""
        if self._open is not None:
            os.close(self._open)
            self._open = None
