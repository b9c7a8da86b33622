"""A table of any shape with a map of its columns: which are time, positions, efforts of a joint."""

import io
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from idim_iv_ros.configuration_file import read_mapping
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.files import FilePath, is_file
from idim_iv_ros.recording.table_file import (
    needs_tables,
    npz_variables,
    parquet_columns,
)
from idim_iv_ros.types import FloatArray
from idim_iv_ros.validation import first_problem

TEXT = (".csv", ".tsv", ".txt")
HDF5 = (".h5", ".hdf5", ".hdf")
SUFFIXES = (*TEXT, *HDF5, ".parquet", ".npz", ".mat")
SIGNALS = ("position", "velocity", "effort", "reference", "velocity_reference", "link")
_EMPTY = ["", "NA", "N/A", "na", "nan", "NaN", "NAN", "null", "NULL", "None", "-", "#N/A"]
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_ANGLES = {"rad": 1.0, "deg": np.pi / 180.0, "rev": 2.0 * np.pi, "m": 1.0, "mm": 1e-3}
_EFFORTS = {"N m": 1.0, "mN m": 1e-3, "N": 1.0, "kN": 1e3, "A": 1.0, "mA": 1e-3}


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid")


class Stamps(_Part):
    """The column of the time, and its unit; `iso`: dates and times of ISO 8601."""

    column: str
    unit: Literal["s", "ms", "us", "ns", "iso"] = "s"


class JointColumns(_Part):
    """Columns of one joint: names of a header, of datasets, or ``NAME[2]`` for a part of one."""

    position: str
    velocity: str | None = None
    effort: str | None = None
    reference: str | None = None
    velocity_reference: str | None = None
    link: str | None = None


class Units(_Part):
    """Units of the columns; those of references and of `link` are the positions'."""

    position: Literal["rad", "deg", "rev", "m", "mm"] = "rad"
    velocity: Literal["rad/s", "deg/s", "rev/s", "rpm", "m/s", "mm/s"] = "rad/s"
    effort: Literal["N m", "mN m", "N", "kN", "A", "mA"] = "N m"


class TableMap(_Part):
    """What a table holds.

    Attributes
    ----------
    file : str
        The table, beside the map if it is no absolute path.
    time : Stamps or None
        None where `rate` says how fast rows follow one another.
    rate : float or None
        Hz.
    joints : dict of str to JointColumns
    units : Units
    delimiter, decimal, comment : str
        Of text: what stands between columns (empty: found), the decimal sign, what begins a line
        that is none of the table (empty: nothing does).
    """

    file: str
    time: Stamps | None = None
    rate: Annotated[float, Field(gt=0.0)] | None = None
    joints: Annotated[dict[str, JointColumns], Field(min_length=1)]
    units: Units = Units()
    delimiter: Annotated[str, Field(max_length=1)] = ""
    decimal: Literal[".", ","] = "."
    comment: str = "#"


def read_map(path: FilePath) -> tuple[TableMap, Path]:
    """Read a map, and where its table is.

    Raises
    ------
    UsageError
        It is no map, or names a table that is not there.
    """
    path = Path(path)
    try:
        described = TableMap.model_validate(read_mapping(path))
    except ValidationError as error:
        raise UsageError(f"{path}: {first_problem(error)}") from error
    if (described.time is None) == (described.rate is None):
        raise UsageError(f"{path}: give either time or rate")
    table = path.parent / described.file
    if not is_file(table):
        raise UsageError(f"{path}: file: {table}: no such file")
    if table.suffix.lower() not in SUFFIXES:
        raise UsageError(f"{table}: not a table ({', '.join(SUFFIXES)})")
    return described, table


def mapped_columns(
    described: TableMap, table: Path
) -> tuple[FloatArray | None, dict[str, FloatArray]]:
    """Stamps (n,) s, None where there is a rate, and every signal (n, n_joints) in SI units.

    Raises
    ------
    UsageError, DataError
        No such column, something else than numbers in one, or a signal of some joints only.
    """
    signals: dict[str, list[str]] = {}
    for signal in SIGNALS:
        columns = [getattr(joint, signal) for joint in described.joints.values()]
        given = [column for column in columns if column is not None]
        if given and len(given) < len(columns):
            missing = [
                name
                for name, column in zip(described.joints, columns, strict=True)
                if column is None
            ]
            raise UsageError(
                f"{signal} of {', '.join(missing)} is missing; give it for all joints, or for none"
            )
        if given:
            signals[signal] = given
    wanted = [column for columns in signals.values() for column in columns]
    time = described.time
    values = read_columns(table, described, [*wanted, *([] if time is None else [time.column])])
    stamps = None
    if time is not None:
        stamps = values[time.column]
        if time.unit == "iso":
            stamps = stamps - stamps[0]
        elif time.unit != "s":
            stamps = (stamps - stamps[0]) * _SECONDS[time.unit]
    return stamps, {
        signal: _scale(signal, described.units) * np.column_stack([values[c] for c in columns])
        for signal, columns in signals.items()
    }


def _scale(signal: str, units: Units) -> float:
    if signal == "effort":
        return _EFFORTS[units.effort]
    if "velocity" in signal:
        if units.velocity == "rpm":
            return 2.0 * np.pi / 60.0
        return _ANGLES[units.velocity.removesuffix("/s")]
    return _ANGLES[units.position]


def read_columns(table: Path, described: TableMap, wanted: list[str]) -> dict[str, FloatArray]:
    """Columns (n,) by their names; those of an ISO time are s since 1970."""
    suffix = table.suffix.lower()
    iso = described.time.column if described.time and described.time.unit == "iso" else ""
    try:
        if suffix in TEXT:
            found = _text_columns(table, described, wanted, iso)
        else:
            found = {name: _part(table, suffix, name) for name in wanted}
    except OSError as error:
        raise UsageError(f"{table}: cannot be read: {error.strerror or error}") from error
    lengths = {len(column) for column in found.values()}
    if len(lengths) > 1:
        listed = ", ".join(f"{name}: {len(column)}" for name, column in found.items())
        raise DataError(f"{table}: columns of different lengths ({listed})")
    return found


def column_names(table: Path, comment: str = "#") -> list[str]:
    """Names that a map may use: of columns, or of datasets, ``NAME[k]`` for parts of one."""
    suffix = table.suffix.lower()
    if suffix in TEXT:
        return list(_text_table(table, TableMap(file=table.name, rate=1.0, joints={
            "joint": JointColumns(position="")}, comment=comment), "").column_names)  # fmt: skip
    names: list[str] = []
    for name, shape in _datasets(table, suffix).items():
        wide = [length for length in shape if length > 1]
        columns = min(wide) if len(wide) > 1 else 1
        names += [f"{name}[{k}]" for k in range(columns)] if columns > 1 else [name]
    return names


def _datasets(table: Path, suffix: str) -> dict[str, tuple[int, ...]]:
    if suffix == ".parquet":
        parquet = needs_tables(table, "pyarrow.parquet")
        return dict.fromkeys(parquet.read_schema(table).names, ())
    if suffix == ".npz":
        with np.load(table, allow_pickle=False) as variables:
            return {name: variables[name].shape for name in variables.files}
    if suffix == ".mat":
        from scipy.io import whosmat

        return {name: shape for name, shape, _ in whosmat(table)}
    shapes: dict[str, tuple[int, ...]] = {}
    h5py = needs_tables(table, "h5py")
    with h5py.File(table) as file:
        file.visititems(
            lambda name, item: shapes.update({name: item.shape}) if hasattr(item, "shape") else None
        )
    return shapes


def _part(table: Path, suffix: str, name: str) -> FloatArray:
    """One column of a file of arrays: a whole one, or ``NAME[k]``."""
    whole, _, rest = name.partition("[")
    values = _array(table, suffix, whole)
    if not rest:
        if values.ndim > 1 and min(values.shape) > 1:
            raise UsageError(
                f"{table}: {name} has {min(values.shape)} columns; say which, {name}[0]"
            )
        return np.ravel(values)
    number = rest.rstrip("]")
    rows = values if values.ndim < 2 or values.shape[0] >= values.shape[1] else values.T
    if not number.isdigit() or rows.ndim != 2 or int(number) >= rows.shape[1]:
        raise UsageError(f"{table}: no column {name}")
    return np.asarray(rows[:, int(number)])


def _array(table: Path, suffix: str, name: str) -> FloatArray:
    names = _datasets(table, suffix)
    if name not in names:
        raise UsageError(f"{table}: no {name}; there are {', '.join(sorted(names)[:30])}")
    values: Any
    if suffix == ".parquet":
        values = parquet_columns([table], name)
    elif suffix == ".npz":
        values = npz_variables(table, name)
    elif suffix == ".mat":
        from scipy.io import loadmat

        values = loadmat(table, variable_names=[name])[name]
    else:
        with needs_tables(table, "h5py").File(table) as file:
            values = file[name][()]
    array = np.asarray(values)
    if array.dtype.kind not in "iuf":
        raise UsageError(f"{table}: {name} holds something else than numbers ({array.dtype})")
    return array.astype(float, copy=False)


def _text_columns(
    table: Path, described: TableMap, wanted: list[str], iso: str
) -> dict[str, FloatArray]:
    read = _text_table(table, described, iso)
    made = {}
    for name in dict.fromkeys(wanted):
        if read.column_names.count(name) != 1:
            why = "no column" if name not in read.column_names else "more than one column"
            raise UsageError(f"{table}: {why} {name}; there are {', '.join(read.column_names)}")
        column = read[name]
        kind = str(column.type)
        if name == iso and kind.startswith("timestamp"):
            made[name] = column.cast("timestamp[ns]").cast("int64").to_numpy() * 1e-9
        elif kind in ("int64", "double", "null"):
            made[name] = column.cast("double").to_numpy(zero_copy_only=False)
        else:
            shown = next((str(v) for v in column.to_pylist() if not _is_number(v)), "")
            raise DataError(
                f"{table}: {name} holds {shown[:40]!r}: no number"
                + ("" if name != iso else " and no time of ISO 8601")
                + "; set decimal, delimiter, comment or time.unit in the map"
            )
    return made


def _is_number(value: object) -> bool:
    try:
        float(str(value))
    except ValueError:
        return False
    return True


def _text_table(table: Path, described: TableMap, iso: str) -> Any:
    """The whole table; empty cells are missing, lines that begin with the comment left out."""
    csv = needs_tables(table, "pyarrow.csv")
    content = table.read_bytes().removeprefix(b"\xef\xbb\xbf")
    if described.comment:
        start = described.comment.encode()
        lines = [line for line in content.splitlines() if not line.lstrip().startswith(start)]
        content = b"\n".join(lines)
    delimiter = described.delimiter or _delimiter(content, described.decimal)
    try:
        return csv.read_csv(
            io.BytesIO(content),
            parse_options=csv.ParseOptions(delimiter=delimiter),
            convert_options=csv.ConvertOptions(
                decimal_point=described.decimal,
                null_values=_EMPTY,
                strings_can_be_null=True,
                timestamp_parsers=[csv.ISO8601] if iso else ["%never"],
            ),
        )
    except Exception as error:  # pyarrow's own
        reason = " ".join(str(error).split())
        raise DataError(
            f"{table}: not a table: {reason[:200]}; set delimiter, decimal or comment in the map"
        ) from error


def _delimiter(content: bytes, decimal: str) -> str:
    """What stands most often in the first line; a comma only where it is no decimal sign."""
    first = content.split(b"\n", 1)[0].decode("utf-8", "replace")
    signs = [sign for sign in (",", ";", "\t", "|") if sign != decimal]
    return max(signs, key=first.count)
