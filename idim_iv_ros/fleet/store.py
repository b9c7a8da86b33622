"""Results of bags on disk, one file each under its key: written whole or not at all."""

import json
from pathlib import Path

from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import write_together
from idim_iv_ros.fleet.bag_result import BagResult

FOLDER = "bags"  # below the results of the fleet


class BagStore:
    """The results that earlier runs left, and those of this one.

    Parameters
    ----------
    folder
        Made when the first result is written.
    """

    def __init__(self, folder: Path):
        self.folder = folder

    def get(self, key: str) -> BagResult | None:
        """Return the result under a key; None where there is none that this version can read."""
        path = self._path(key)
        try:
            return BagResult.from_json(path.read_text(encoding="utf-8"), str(path))
        except (FileNotFoundError, UsageError, ValueError):
            return None

    def put(self, result: BagResult) -> None:
        """Write a result under its key.

        Raises
        ------
        UsageError
            It cannot be written, and why.
        """
        path = self._path(result.key)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            text = json.dumps(result.to_document(), ensure_ascii=False, allow_nan=False)
            write_together({path: text + "\n"})
        except OSError as error:
            raise UsageError(f"{path}: cannot be written: {error.strerror or error}") from error

    def _path(self, key: str) -> Path:
        return self.folder / f"{key}.json"
