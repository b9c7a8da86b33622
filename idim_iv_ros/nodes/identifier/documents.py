"""JSON documents that the nodes read and keep."""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from idim_iv_ros.errors import DataError, UsageError

Document = Mapping[str, Any]


def read_document(path: Path, form: str) -> Document:
    """Return the content of a document.

    Parameters
    ----------
    path
    form
        What its key `format` must hold.

    Raises
    ------
    DataError
        There is none, or it is of another format.
    """
    try:
        document: Document = json.loads(path.read_text(encoding="utf-8"))
        if document["format"] != form:
            raise DataError(f"{path}: its format is not {form}")
        return document
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DataError(f"{path}: cannot be read as a result") from error


def write_document(path: Path, document: Document) -> None:
    """Write a document, complete or not at all, also if the power fails.

    Raises
    ------
    UsageError
        It cannot be written, and why.
    """
    temporary = path.with_name(f".{path.name}.part")
    try:
        with temporary.open("w", encoding="utf-8") as stream:
            json.dump(document, stream, indent=1, ensure_ascii=False, allow_nan=False)
            stream.flush()
            os.fsync(stream.fileno())
        temporary.replace(path)
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror}") from error


def number(value: float | None) -> float:
    """Return a number of a message; NaN where it does not exist."""
    return float("nan") if value is None else float(value)
