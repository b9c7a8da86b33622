"""Documents of this program: JSON that one class writes, checks and reads back as itself."""

import math
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar

import numpy as np
from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    TypeAdapter,
    ValidationError,
    WithJsonSchema,
    WrapValidator,
)
from pydantic.json_schema import GenerateJsonSchema
from pydantic_core import from_json

from idim_iv_ros.encoding import json_text
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import FilePath, read_text, refused_if_unwritable, write_together
from idim_iv_ros.types import FloatArray
from idim_iv_ros.validation import first_problem

_NUMBER_OR_NULL = {"anyOf": [{"type": "number"}, {"type": "null"}]}

T = TypeVar("T")
D = TypeVar("D", bound="Document")


def _null_as(number: float) -> WrapValidator:
    return WrapValidator(lambda value, check: number if value is None else check(value))


# Numbers that may not exist (NaN), and ends that may be open: null in a document.
Number = Annotated[float, _null_as(math.nan), WithJsonSchema(_NUMBER_OR_NULL)]
LowEnd = Annotated[float, _null_as(-math.inf), WithJsonSchema(_NUMBER_OR_NULL)]
HighEnd = Annotated[float, _null_as(math.inf), WithJsonSchema(_NUMBER_OR_NULL)]

Matrix = Annotated[
    FloatArray,
    BeforeValidator(
        lambda rows: np.array(TypeAdapter(list[list[Number]]).validate_python(rows), dtype=float)
    ),
    PlainSerializer(np.ndarray.tolist),
    WithJsonSchema({"type": "array", "items": {"type": "array", "items": _NUMBER_OR_NULL}}),
]

# What a report draws and a document leaves out.
Unsaved = Annotated[T, Field(exclude=True)]


class Document:
    """Base of a frozen dataclass that is a document: its fields, in their order, are the keys.

    A field of type `Unsaved` is left out. `what` says what it is (``a diagnosis``) and `written_by`
    which command writes it, for messages; the default of `format`, the first field, names the
    format.
    """

    what: ClassVar[str]
    written_by: ClassVar[str]
    format: str
    __pydantic_config__ = ConfigDict(
        extra="forbid", strict=True, allow_inf_nan=False, arbitrary_types_allowed=True
    )

    def to_document(self) -> dict[str, Any]:
        """Return the document as plain Python values; numbers that do not exist are None."""
        values = _adapter(type(self)).dump_python(self, by_alias=True, warnings=False)
        return dict(_plain(values))

    def to_json(self) -> str:
        """Return the document as text."""
        return json_text(self.to_document())

    def write(self, path: FilePath) -> None:
        """Write the document, complete or not at all; a UsageError says why it cannot be."""
        with refused_if_unwritable(path):
            write_together({Path(path): self.to_json()})

    @classmethod
    def read(cls: type[D], path: FilePath) -> D:
        """Read a document that `write` wrote; a UsageError says what is wrong, as `from_json`."""
        text = read_text(Path(path), f"the {cls.what.partition(' ')[2]}")
        return cls.from_json(text, str(path))

    @classmethod
    def from_json(cls: type[D], text: str, name: str) -> D:
        """Read a document from the text of the file `name`.

        Raises UsageError: not JSON, another format, or a key that is missing, wrong or unknown; one
        line with the file, the key and what to do.
        """
        again = f"write it with this version's `idim-iv {cls.written_by}`"
        try:
            content = from_json(text)
        except ValueError as error:
            raise UsageError(f"{name}: not JSON: {error}") from error
        stated = content.get("format") if isinstance(content, Mapping) else None
        if stated != cls.format:
            shown = repr(stated) if isinstance(stated, str) else "missing"
            raise UsageError(
                f"{name}: not {cls.what}: its format is {shown}, not {cls.format!r}; {again}"
            )
        try:
            # From the text: a list of JSON may then stand for a tuple, and nothing for a number.
            document: D = _adapter(cls).validate_json(text)
            return document
        except ValidationError as error:
            raise UsageError(f"{name}: {first_problem(error)}; {again}") from error

    @classmethod
    def json_schema(cls) -> dict[str, Any]:
        """Return the JSON Schema of the documents that `write` writes."""
        return _adapter(cls).json_schema(mode="serialization", schema_generator=_WholeSchema)


class _WholeSchema(GenerateJsonSchema):
    """Every key is written, also one with a default; none needs a title beside its name."""

    def field_is_required(self, field: Any, total: bool) -> bool:
        return True

    def field_title_should_be_set(self, schema: Any) -> bool:
        return False


_adapter: Callable[[Any], TypeAdapter[Any]] = cache(TypeAdapter)


def _plain(value: object) -> Any:
    """Return the value with plain Python types only; what is not a finite number is None."""
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, np.generic | np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Iterable):
        return [_plain(item) for item in value]
    raise TypeError(f"{type(value).__name__} has no place in a document")
