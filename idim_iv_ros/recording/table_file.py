"""Numbers in .csv, .npy, .npz, .mat, .parquet and .h5 files, by the names of their columns."""

import csv
import warnings
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.types import FloatArray

TEXT = (".csv", ".tsv", ".txt")
ARRAYS = (".npy", ".npz", ".mat", ".parquet", ".h5", ".hdf5", ".hdf")
NPY = "array"  # what the numbers of a .npy file are called
_EMPTY = {"", "NA", "N/A", "na", "nan", "NaN", "NAN", "null", "NULL", "None", "-", "#N/A"}
_ROWS_AT_ONCE = 10_000  # of a text
_COMMA = str.maketrans(",.", ".,")
_NUMBERS = "iuf"  # kinds of numpy: integers, unsigned ones, floats
_LARGEST = 1 << 30  # bytes of one array


@contextmanager
def one_line_errors(path: Path) -> Iterator[None]:
    """Turn every error of a table reader into a one-line error that names the file.

    Readers of numpy, scipy, pyarrow and h5py raise undocumented errors for damaged files.
    """
    try:
        # What is wrong is said by the error; a warning would only come beside it.
        with warnings.catch_warnings(action="ignore"):
            yield
    except (UsageError, DataError):
        raise
    except UnicodeDecodeError as error:
        raise UsageError(f"{path}: no text in UTF-8; save it as UTF-8") from error
    except MemoryError as error:
        raise UsageError(f"{path}: claims more numbers than fit into memory") from error
    except Exception as error:
        if isinstance(error, OSError) and error.strerror:
            raise UsageError(f"{path}: cannot be read: {error.strerror}") from error
        reason = " ".join(str(error).split()) or type(error).__name__
        raise UsageError(f"{path}: not a table that can be read: {reason[:200]}") from error


def array_shapes(path: Path) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the variables in a file, by name."""
    suffix = path.suffix.lower()
    if suffix == ".npy":
        return {NPY: np.load(path, mmap_mode="r", allow_pickle=False).shape}
    if suffix == ".parquet":
        file = needs_tables(path, "pyarrow.parquet").ParquetFile(path)
        rows = next(file.iter_batches(1)).to_pylist() if file.metadata.num_rows else [{}]
        first = {name: rows[0].get(name) for name in file.schema_arrow.names}
        return {
            name: (file.metadata.num_rows, len(value) if isinstance(value, list) else 1)
            for name, value in first.items()
        }
    if suffix == ".npz":
        return _npz_shapes(path)
    if suffix == ".mat":
        from scipy.io import whosmat  # here, because a recorder starts faster without it

        return {name: shape for name, shape, _ in whosmat(path)}
    with needs_tables(path, "h5py").File(path) as file:
        names: list[str] = []
        file.visit(names.append)
        return {name: file[name].shape for name in names if hasattr(file[name], "shape")}


def read_array(path: Path, name: str) -> FloatArray:
    """Return one variable of a file as numbers (n_samples, n_columns).

    Raises UsageError: no such variable, or it holds something else than real numbers.
    """
    if name not in (names := array_shapes(path)):
        listed = ", ".join(sorted(names)) or "none"
        raise UsageError(f"{path}: no variable {name}; there are {listed}")
    array = np.asarray(_array(path, name))
    if array.dtype.kind not in _NUMBERS:
        kind = "complex numbers" if array.dtype.kind == "c" else str(array.dtype)
        raise UsageError(f"{path}: {name} holds something else than real numbers ({kind})")
    if array.ndim > 2:
        dimensions = f"{array.ndim} dimensions; samples and joints are needed"
        raise UsageError(f"{path}: {name}: {dimensions}")
    # Beyond double precision they are infinite, which is refused later.
    with np.errstate(over="ignore"):
        columns = array.astype(float, copy=False).reshape(len(array) if array.ndim else 1, -1)
    return columns if columns.shape[0] >= columns.shape[1] else columns.T


def _array(path: Path, name: str) -> Any:
    """Return one variable of a file; dates in s since 1970."""
    suffix = path.suffix.lower()
    if suffix == ".npy":
        # Mapped, so that a header that claims more than the file holds is an error and no memory.
        array = np.load(path, mmap_mode="r", allow_pickle=False)
        _require_size(path, array.nbytes)
        return array
    if suffix == ".parquet":
        table = needs_tables(path, "pyarrow.parquet").read_table(path, columns=[name])
        if table.schema.types[0].id == import_module("pyarrow").timestamp("ns").id:
            stamps = table[name].cast("timestamp[ns]").cast("int64").to_numpy()
            return 1e-9 * np.asarray(stamps, dtype=float)[:, None]
        rows = table[name].to_pylist()  # lists are columns
        return np.array(rows, dtype=float).reshape(len(rows), -1 if rows else 1)
    if suffix == ".npz":
        with zipfile.ZipFile(path) as archive:
            _require_size(path, archive.getinfo(f"{name}.npy").file_size)
        with np.load(path, allow_pickle=False) as variables:
            return variables[name]
    if suffix == ".mat":
        from scipy.io import loadmat

        return loadmat(path, variable_names=[name])[name]
    with needs_tables(path, "h5py").File(path) as file:
        return file[name][()]


def needs_tables(path: Path, module: str) -> Any:
    """Import a module that only some tables need; raise UsageError where it is not installed."""
    try:
        return import_module(module)
    except ImportError as error:
        name = module.partition(".")[0]
        raise UsageError(f'{path}: needs {name}: pip install "idim-iv-ros[tables]"') from error


class TextTable:
    """A table in text, with or without a row of names.

    `delimiter` between columns; empty: the most frequent one in the first row. `decimal`: ``.`` or
    ``,``. `comment` begins lines that are skipped; empty: none. `names`: names of the columns, or
    their numbers from 0. A comment in front of the numbers counts as names if it has as many
    columns, as NumPy writes it.

    Raises UsageError: there is nothing but comments.
    """

    def __init__(
        self, path: Path, delimiter: str = "", decimal: str = ".", comment: str = "#"
    ) -> None:
        self._path, self._decimal, self._comment = path, decimal, comment
        last_comment, first = "", ""
        for line in self._lines():
            if first := self._without_comment(line):
                break
            last_comment = line.strip().removeprefix(comment)
        if not first:
            raise UsageError(f"{path}: holds no row of a table; give another file")
        signs = [sign for sign in (",", ";", "\t", "|") if sign != decimal]
        self._delimiter = delimiter or max(signs, key=first.count)
        cells, described = (
            [cell.strip() for cell in next(csv.reader([line], delimiter=self._delimiter), [])]
            for line in (first, last_comment)
        )
        self._headed = not all(map(is_number, cells))
        named = cells if self._headed else described
        self.names = named if len(named) == len(cells) else [str(k) for k in range(len(cells))]

    def _lines(self) -> Iterator[str]:
        with self._path.open(encoding="utf-8-sig", newline="") as file:
            yield from (line for line in file if not line.isspace())

    def _without_comment(self, line: str) -> str:
        sign = self._comment
        return "" if sign and sign in line and line.lstrip().startswith(sign) else line

    def number(self, column: str) -> int:
        """Return the number, from 0, of a column given by its name or number.

        Raises UsageError: there is none, or several.
        """
        if self.names.count(column) > 1:
            raise UsageError(
                f"{self._path}: {self.names.count(column)} columns are named {column}; give their "
                "numbers from 0"
            )
        if column in self.names:
            return self.names.index(column)
        if column.isdigit() and int(column) < len(self.names):
            return int(column)
        listed = ", ".join(self.names)
        raise UsageError(f"{self._path}: no column {column}; there are {listed}, or numbers from 0")

    def columns(self, wanted: Sequence[int], time: int | None = None) -> list[FloatArray]:
        """Return columns (n,) by their numbers; empty cells are NaN.

        `time`: number of a column that may hold dates of ISO 8601, read as s since 1970.

        Raises DataError: rows of different lengths, or a cell that is no number.
        """
        rows = csv.reader(filter(self._without_comment, self._lines()), delimiter=self._delimiter)
        parts: list[list[FloatArray]] = [[np.zeros(0)] for _ in wanted]
        for _ in range(self._headed):
            next(rows)
        while block := list(islice(rows, _ROWS_AT_ONCE)):
            if set(map(len, block)) != {len(self.names)}:
                odd = next(row for row in block if len(row) != len(self.names))
                raise DataError(
                    f"{self._path}: not a table: a row of {len(odd)} columns, where the first has "
                    f"{len(self.names)}: {self._delimiter.join(odd)[:60]!r}"
                )
            for part, column in zip(parts, wanted, strict=True):
                cells = [row[column] for row in block]
                part.append(self._values(column, cells, dates=column == time))
        return [np.concatenate(part) for part in parts]

    def _values(self, column: int, cells: list[str], *, dates: bool) -> FloatArray:
        # Where the decimal sign is a comma, a point is a sign of something else.
        plain = [c.translate(_COMMA) for c in cells] if self._decimal == "," else cells
        with suppress(ValueError):  # mostly no cell is empty
            return np.array(plain, dtype=float)
        with suppress(ValueError):
            return np.array(["nan" if c.strip() in _EMPTY else c for c in plain], dtype=float)
        if dates:
            with suppress(ValueError):
                stamps: FloatArray = np.array(cells, dtype="datetime64[ns]").astype(np.float64)
                return 1e-9 * stamps
        wrong = next(cell for cell in plain if cell.strip() not in _EMPTY and not is_number(cell))
        raise DataError(
            f"{self._path}: {self.names[column]} holds {wrong[:40]!r}: no number"
            f"{' and no time of ISO 8601' if dates else ''}; a map of the columns may set decimal, "
            "delimiter, comment or time.unit"
        )


def _npz_shapes(path: Path) -> dict[str, tuple[int, ...]]:
    """Return the shapes of variables from their headers, without unpacking them."""
    shapes = {}
    with zipfile.ZipFile(path) as archive:
        for name in archive.namelist():
            with archive.open(name) as stream:
                if np.lib.format.read_magic(stream) == (1, 0):
                    shape, _, _ = np.lib.format.read_array_header_1_0(stream)
                else:
                    shape, _, _ = np.lib.format.read_array_header_2_0(stream)
            shapes[name.removesuffix(".npy")] = shape
    return shapes


def _require_size(path: Path, size: int) -> None:
    if size > _LARGEST:
        advice = "split it into bags of less than 1 GB"
        raise UsageError(f"{path}: {size / 1e9:.3g} GB in one array; {advice}")


def is_number(value: object) -> bool:
    """Return whether a text can be read as a number."""
    try:
        float(str(value))
    except ValueError:
        return False
    return True
