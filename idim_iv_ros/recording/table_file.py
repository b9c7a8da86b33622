"""Numbers in .csv, .npy, .npz, .mat and .parquet files: ``FILE`` or ``FILE:KEY``."""

import warnings
import zipfile
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.files import is_file
from idim_iv_ros.types import FloatArray

_Wanted = TypeVar("_Wanted", str, int)  # name of a variable, or number of a column

SUFFIXES = (".csv", ".npy", ".npz", ".mat", ".parquet")
_NUMBERS = "iuf"  # kinds of numpy: integers, unsigned ones, floats
_LARGEST = 1 << 30  # bytes of one array


def read_table(spec: str) -> FloatArray:
    """Two-dimensional numbers (n_samples, n_columns) of ``FILE[:KEY]``.

    Raises
    ------
    UsageError
        No such file, variable or column, or something else than real numbers.
    """
    path, key = _split(spec)
    try:
        # What is wrong is said by the error; a warning would only come beside it.
        with warnings.catch_warnings(action="ignore"):
            values = _load(path, key)
    except (UsageError, DataError):
        raise
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror or error}") from error
    except MemoryError as error:
        raise UsageError(f"{path}: claims more numbers than fit into memory") from error
    except Exception as error:
        # The readers of numpy and scipy raise more than is written down when the bytes are not
        # what the name of the file says.
        reason = " ".join(str(error).split()) or type(error).__name__
        raise UsageError(f"{path}: not a table that can be read: {reason[:200]}") from error
    array = np.asarray(values)
    if array.dtype.kind == "c":
        raise UsageError(f"{spec}: holds complex numbers; real ones are needed")
    if array.dtype.kind not in _NUMBERS:
        raise UsageError(f"{spec}: holds something else than numbers ({array.dtype})")
    if array.ndim == 1:
        array = array[:, None]
    if array.ndim != 2:
        raise UsageError(f"{spec}: {array.ndim} dimensions; samples and joints are needed")
    with np.errstate(over="ignore"):  # beyond double precision: infinite, which is refused later
        array = array.astype(float, copy=False)
    return array if array.shape[0] >= array.shape[1] else array.T


def _split(spec: str) -> tuple[Path, str | None]:
    name, colon, key = spec.rpartition(":")
    if not colon or _is_there(spec):
        path, key_or_none = Path(spec), None
    else:
        path, key_or_none = Path(name), key
    if not is_file(path):
        raise UsageError(f"{path}: no such file")
    if path.suffix.lower() not in SUFFIXES:
        raise UsageError(f"{path}: not a table ({', '.join(SUFFIXES)})")
    return path, key_or_none


def _is_there(spec: str) -> bool:
    """Whether the whole of ``FILE:KEY`` is the name of a file."""
    try:
        return is_file(Path(spec))
    except UsageError:
        return False


def _load(path: Path, key: str | None) -> Any:
    suffix = path.suffix.lower()
    if suffix == ".csv":
        return _csv(path, key)
    if suffix == ".npy":
        # Mapped, so that a header that claims more than the file holds is an error and no memory.
        array = np.load(path, mmap_mode="r", allow_pickle=False)
        _require_size(path, array.nbytes)
        if key is None:
            return array
        return array[:, _different(path, [_column(path, part) for part in key.split(",")])]
    if suffix == ".npz":
        return npz_variables(path, key)
    if suffix == ".parquet":
        return parquet_columns([path], key)
    from scipy.io import loadmat, whosmat  # here, because a recorder starts faster without it

    names = [name for name, _, _ in whosmat(path)]
    wanted = _variables(path, names, key)
    loaded = loadmat(path, variable_names=wanted)
    return _joined([loaded[name] for name in wanted])


def parquet_columns(paths: Sequence[Path], key: str | None, **options: Any) -> FloatArray:
    """Columns of parquet files, (n_samples, n_columns); a column of lists has several.

    Parameters
    ----------
    key
        Names with commas between them; None where there is one column.
    options
        Of `pyarrow.parquet.read_table`, for example its `filters`.

    Raises
    ------
    UsageError
        pyarrow is not installed, or there is no such column.
    """
    parquet = needs_tables(paths[0], "pyarrow.parquet")
    wanted = _variables(paths[0], parquet.read_schema(paths[0]).names, key)
    tables = [parquet.read_table(path, columns=wanted, **options) for path in paths]
    parts = []
    for name in wanted:
        rows = [row for table in tables for row in table[name].to_pylist()]
        parts.append(np.array(rows, dtype=float).reshape(len(rows), -1 if rows else 1))
    return np.column_stack(parts)


def needs_tables(path: Path, module: str) -> Any:
    """Return a module that only some tables need.

    Raises
    ------
    UsageError
        It is not installed.
    """
    try:
        return import_module(module)
    except ImportError as error:
        name = module.partition(".")[0]
        raise UsageError(f'{path}: needs {name}: pip install "idim-iv-ros[tables]"') from error


def npz_variables(path: Path, key: str | None) -> Any:
    """Variables of a .npz, side by side where there are several; no larger than they claim."""
    with zipfile.ZipFile(path) as archive:
        sizes = {entry.filename: entry.file_size for entry in archive.infolist()}
    with np.load(path, allow_pickle=False) as variables:
        wanted = _variables(path, list(variables.files), key)
        for name in wanted:
            _require_size(path, sizes.get(f"{name}.npy", 0))
            _require_claim(path, name, sizes.get(f"{name}.npy", 0))
        return _joined([variables[name] for name in wanted])


def _require_claim(path: Path, name: str, size: int) -> None:
    """Refuse an array whose header claims more than is packed: numpy makes room for the claim."""
    with zipfile.ZipFile(path) as archive, archive.open(f"{name}.npy") as stream:
        version = np.lib.format.read_magic(stream)
        read = (
            np.lib.format.read_array_header_1_0
            if version == (1, 0)
            else np.lib.format.read_array_header_2_0
        )
        shape, _, dtype = read(stream)
    claimed = dtype.itemsize
    for length in shape:
        claimed *= int(length)
    if not 0 <= claimed <= size:
        raise ValueError(f"{name} claims {claimed:.4g} bytes, and there are {size}")


def _require_size(path: Path, size: int) -> None:
    if size > _LARGEST:
        raise UsageError(
            f"{path}: {size / 1e9:.3g} GB in one array; split it into bags of less than 1 GB"
        )


def _variables(path: Path, names: list[str], key: str | None) -> list[str]:
    """Names of the wanted variables: the only one, the one that is named, or several."""
    if key is None and len(names) == 1:
        return names
    listed = ", ".join(sorted(names)) or "none"
    if key is None:
        raise UsageError(f"{path}: say which variable, FILE:KEY; there are {listed}")
    wanted = [key] if key in names else key.split(",")
    for name in wanted:
        if name not in names:
            raise UsageError(f"{path}: no variable {name}; there are {listed}")
    return _different(path, wanted)


def _different(path: Path, wanted: list[_Wanted]) -> list[_Wanted]:
    """Refuse what is asked for twice: it would be the signal of two joints."""
    for each in wanted:
        if wanted.count(each) > 1:
            raise UsageError(f"{path}: {each} is given twice; each joint has its own")
    return wanted


def _joined(variables: list[Any]) -> Any:
    if len(variables) == 1:
        return variables[0]
    return np.column_stack([np.ravel(variable) for variable in variables])


def _column(path: Path, text: str) -> int:
    if not text.isdigit():
        raise UsageError(f"{path}: no column {text}; columns are numbers from 0")
    return int(text)


def _csv(path: Path, key: str | None) -> FloatArray:
    with path.open(encoding="utf-8-sig") as file:
        first = file.readline().strip()
    delimiter = ";" if first.count(";") > first.count(",") else ","
    names = [name.strip().strip('"') for name in first.split(delimiter)]
    headed = not all(_is_number(name) for name in names)
    wanted = None
    if key is not None:
        wanted = []
        for column in key.split(","):
            if headed and names.count(column) > 1:
                raise UsageError(
                    f"{path}: {names.count(column)} columns are named {column}; give their numbers "
                    "from 0"
                )
            if headed and column in names:
                wanted.append(names.index(column))
            elif column.isdigit() and int(column) < len(names):
                wanted.append(int(column))
            else:
                listed = ", ".join(names) if headed else f"0 to {len(names) - 1}"
                raise UsageError(
                    f"{path}: no column {column}; there are {listed}"
                    + (", or numbers from 0" if headed else "")
                )
        wanted = _different(path, wanted)
    return np.loadtxt(
        path,
        delimiter=delimiter,
        skiprows=1 if headed else 0,
        usecols=wanted,
        ndmin=2,
        encoding="utf-8-sig",
    )


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
