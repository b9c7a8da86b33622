"""Text files that appear complete and together, or not at all."""

import os
from collections.abc import Mapping
from pathlib import Path


def probe_place(path: Path) -> None:
    """Find out, before long work, whether a file can be written beside `path`.

    Raises
    ------
    OSError
        It cannot, and why.
    """
    probe = _temporary(path)
    try:
        probe.write_bytes(b"\0")
    finally:
        probe.unlink(missing_ok=True)


def write_together(texts: Mapping[Path, str]) -> None:
    """Write files beside their places and move them there when all are complete.

    Raises
    ------
    OSError
        A file cannot be written, or a folder has its name.
    """
    temporary = {path: _temporary(path) for path in texts}
    try:
        for path, text in texts.items():
            if path.is_dir():
                raise IsADirectoryError(f"{path} is a folder")
            with temporary[path].open("w", encoding="utf-8") as file:
                file.write(text)
                file.flush()
                os.fsync(file.fileno())
        for path in texts:
            temporary[path].replace(path)
    finally:
        for path in temporary.values():
            path.unlink(missing_ok=True)


def _temporary(path: Path) -> Path:
    return path.with_name(f".{path.name}.{os.getpid()}.tmp")
