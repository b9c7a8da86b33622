"""Results on disk, one file each under its key: written whole or not at all."""

from pathlib import Path
from typing import Generic, TypeVar

from idim_iv_ros.documents import Document
from idim_iv_ros.encoding import json_text
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import write_together

D = TypeVar("D", bound=Document)


class Store(Generic[D]):
    """The results that earlier runs left, and those of this one.

    Parameters
    ----------
    folder
        Made when the first result is written.
    kind
        What they are.
    """

    def __init__(self, folder: Path, kind: type[D]):
        self.folder, self.kind = folder, kind

    def get(self, key: str) -> D | None:
        """Return the result under a key; None where there is none that this version can read."""
        path = self._path(key)
        try:
            return self.kind.from_json(path.read_text(encoding="utf-8"), str(path))
        except (FileNotFoundError, UsageError, ValueError):
            return None

    def put(self, key: str, result: D) -> None:
        """Write a result under its key.

        Raises
        ------
        UsageError
            It cannot be written, and why.
        """
        path = self._path(key)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_together({path: json_text(result.to_document(), indent=None)})
        except OSError as error:
            raise UsageError(f"{path}: cannot be written: {error.strerror or error}") from error

    def _path(self, key: str) -> Path:
        return self.folder / f"{key}.json"
