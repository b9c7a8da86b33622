"""Paths as callers give them: text or `Path`, one or many."""

import os
from collections.abc import Iterable
from pathlib import Path

from idim_iv_ros.errors import UsageError

FilePath = str | os.PathLike[str]
FilePaths = FilePath | Iterable[FilePath]


def as_paths(bags: FilePaths) -> tuple[Path, ...]:
    """Return one or many bags as paths.

    Raises
    ------
    UsageError
        There is none.
    """
    given = [bags] if isinstance(bags, (str, os.PathLike)) else list(bags)
    if not given:
        raise UsageError("no bag was given; at least one is needed")
    return tuple(Path(each) for each in given)
