"""Text files that appear complete and together, or not at all."""

import os
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from functools import partial
from pathlib import Path

from idim_iv_ros.errors import UsageError
from idim_iv_ros.interruption import undone_if_interrupted, uninterrupted
from idim_iv_ros.own_files import require_replaceable


def probe_place(path: Path) -> None:
    """Find out, before long work, whether a file can be written beside `path`.

    Raises
    ------
    OSError
        It cannot, and why.
    """
    probe = temporary_file(path)
    with uninterrupted():
        try:
            probe.write_bytes(b"\0")
        finally:
            probe.unlink(missing_ok=True)


def require_file_place(files: Iterable[Path], *, force: bool = False) -> None:
    """Refuse, before long work, files that could not be written or must not be replaced.

    Raises
    ------
    UsageError
        The folder of a file is missing or cannot be written, or as `require_replaceable`.
    """
    files = list(files)
    require_replaceable(files, force=force)
    for file in files:
        if not file.parent.is_dir():
            raise UsageError(f"{file}: no folder {file.parent}")
        try:
            probe_place(file)
        except OSError as error:
            raise UsageError(f"{file}: cannot be written: {error.strerror or error}") from error


def write_together(texts: Mapping[Path, str]) -> None:
    """Write files beside their places and move them there when all are complete.

    Raises
    ------
    OSError
        A file cannot be written, or a folder has its name.
    """
    temporary = {path: temporary_file(path) for path in texts}
    with ExitStack() as undone:
        for path in temporary.values():
            undone.callback(path.unlink, missing_ok=True)
            undone.enter_context(undone_if_interrupted(partial(path.unlink, missing_ok=True)))
        for path, text in texts.items():
            if path.is_dir():
                raise IsADirectoryError(f"{path} is a folder")
            with temporary[path].open("w", encoding="utf-8") as file:
                file.write(text)
                file.flush()
                os.fsync(file.fileno())
        with uninterrupted():
            for path in texts:
                temporary[path].replace(path)


def temporary_file(path: Path) -> Path:
    """Where a file is written before it is complete."""
    return path.with_name(f".{path.name}.{os.getpid()}.tmp")
