"""Import of tables as bags, by a map: which columns are time, positions, efforts of which joint.

A first map is proposed from the names of the columns, for the user to correct.
"""

import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from idim_iv_ros.configuration_file import read_mapping
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.files import FilePath, is_file, require_file_place
from idim_iv_ros.recording.bags.joint_messages import without_impossible
from idim_iv_ros.recording.table_file import (
    ARRAYS,
    TEXT,
    TextTable,
    array_shapes,
    one_line_errors,
    read_array,
)
from idim_iv_ros.recording.writing.write import JointTopic, write_bag
from idim_iv_ros.types import FloatArray
from idim_iv_ros.validation import first_problem

SUFFIXES = (*TEXT, *ARRAYS)
SIGNALS = ("position", "velocity", "effort", "reference", "velocity_reference", "link")
_SECONDS = {"iso": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}  # iso is read as s
_POSITIONS = {"rad": 1.0, "deg": np.pi / 180.0, "rev": 2.0 * np.pi, "m": 1.0, "mm": 1e-3}
_SPEEDS = {f"{unit}/s": _POSITIONS[unit] for unit in ("rad", "deg", "rev", "m", "mm")}
_SPEEDS["rpm"] = 2.0 * np.pi / 60.0
_EFFORTS = {"N m": 1.0, "mN m": 1e-3, "N": 1.0, "kN": 1e3, "A": 1.0, "mA": 1e-3}
_UNITS_OF = {"position": _POSITIONS, "velocity": _SPEEDS, "effort": _EFFORTS}

_TIME = re.compile(r"^(t|time|times|timestamp|stamp|sec|secs|seconds|clock)([_ .(\[]|$)", re.I)
_UNITS = (("ns", r"ns\b|nano"), ("us", r"us\b|µs|micro"), ("ms", r"ms\b|milli"))
_BRACKETS = re.compile(r"[\[(]([^\])]+)[\])]")
# Words of a name that say which signal it is; what is left says which joint.
_WORDS = {
    "reference": r"ref|reference|des|desired|cmd|command|commanded|target|goal|set|setpoint|action",
    "velocity": r"dq|qd|qdot|vel|velocity|velocities|speed|omega",
    "effort": r"tau|torque|torques|effort|efforts|current|trq|eff|moment",
    "link": r"link|output|load|secondary",
    "position": r"q|pos|position|positions|theta|angle|angles|act|actual|meas|measured|state",
}
# Words that tell no joint from another.
_OF_ALL = re.compile("j|joints?|axis|motor|robot|arm|observation|deg|rad|nm")

_LAST_STAMP = float(2**31 - 1)  # stamps of ROS messages count seconds in 32 bits
_TOPICS = {
    "/joint_states": ("position", "velocity", "effort"),
    "/joint_reference": ("reference", "velocity_reference"),
    "/link_states": ("link",),
}
_KINDS = {"reference": "position", "link": "position", "velocity_reference": "velocity"}


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid")


class Stamps(_Part):
    """The column of the time, and its unit; `iso`: dates and times of ISO 8601."""

    column: str
    unit: Literal["s", "ms", "us", "ns", "iso"] = "s"


class JointColumns(_Part):
    """Columns of one joint, by name; ``NAME[2]`` is one column of an array."""

    position: str
    velocity: str | None = None
    effort: str | None = None
    reference: str | None = None
    velocity_reference: str | None = None
    link: str | None = None


class Units(_Part):
    """Units of the columns; references and `link` have those of positions."""

    position: Literal["rad", "deg", "rev", "m", "mm"] = "rad"
    velocity: Literal["rad/s", "deg/s", "rev/s", "rpm", "m/s", "mm/s"] = "rad/s"
    effort: Literal["N m", "mN m", "N", "kN", "A", "mA"] = "N m"


class TableMap(_Part):
    """Description of a table by a user: columns, units and format."""

    file: str  # the table, relative to the map
    time: Stamps | None = None  # None where `rate` is given instead
    rate: Annotated[float, Field(gt=0.0, le=1e9)] | None = None  # Hz
    # Only rows with these numbers in these columns are read, where there are several recordings.
    rows: dict[str, float] = {}
    joints: Annotated[dict[Annotated[str, Field(min_length=1)], JointColumns], Field(min_length=1)]
    units: Units = Units()
    # These three are as in `TextTable`.
    delimiter: Annotated[str, Field(max_length=1)] = ""
    decimal: Literal[".", ","] = "."
    comment: str = "#"


def read_map(path: FilePath) -> tuple[TableMap, Path]:
    """Return a map read from YAML, and the path of its table.

    Raises UsageError: it is no map, or names a table that is not there.
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


def mapped_columns(described: TableMap, table: Path) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return stamps (n,) s and every signal (n, n_joints) in SI units.

    Raises UsageError or DataError: no such column, a cell that is no number, or a signal of some
    joints.
    """
    signals: dict[str, list[str]] = {}
    for signal in SIGNALS:
        columns = {name: getattr(joint, signal) for name, joint in described.joints.items()}
        missing = [name for name, column in columns.items() if column is None]
        if not missing:
            signals[signal] = list(columns.values())
        elif len(missing) < len(columns):
            raise UsageError(
                f"{signal} of {', '.join(missing)} is missing; give it for all joints, or for none"
            )
    wanted = [*described.rows, *(column for columns in signals.values() for column in columns)]
    time = described.time
    values = _read_columns(table, described, [*wanted, *([] if time is None else [time.column])])
    for column, number in described.rows.items():
        chosen = values[column] == number
        values = {name: numbers[chosen] for name, numbers in values.items()}
    if time is None:
        assert described.rate is not None
        with np.errstate(over="ignore"):
            stamps = np.arange(len(values[wanted[-1]])) / described.rate
    else:
        stamps = values[time.column]
        if time.unit != "s":
            stamps = (stamps - stamps[0]) * _SECONDS[time.unit]
    scales = {kind: _UNITS_OF[kind][unit] for kind, unit in described.units}
    return stamps, {
        signal: scales[_KINDS.get(signal, signal)] * np.column_stack([values[c] for c in columns])
        for signal, columns in signals.items()
    }


def _read_columns(table: Path, described: TableMap, wanted: list[str]) -> dict[str, FloatArray]:
    """Return columns (n,) by name; a time in ISO 8601 as s since 1970."""
    names = list(dict.fromkeys(wanted))
    with one_line_errors(table):
        if table.suffix.lower() in TEXT:
            text = TextTable(table, described.delimiter, described.decimal, described.comment)
            time = described.time
            stamps = text.number(time.column) if time and time.unit == "iso" else None
            read = text.columns([text.number(name) for name in names], stamps)
        else:
            read = _array_columns(table, names)
    columns = dict(zip(names, read, strict=True))
    if len({len(column) for column in read}) > 1:
        listed = ", ".join(f"{name}: {len(column)}" for name, column in columns.items())
        raise DataError(f"{table}: columns of different lengths ({listed})")
    return columns


def column_names(table: Path) -> list[str]:
    """Return names that a map may use: of columns, or of arrays, ``NAME[k]`` for their columns."""
    with one_line_errors(table):
        if table.suffix.lower() in TEXT:
            return TextTable(table).names
        names: list[str] = []
        for name, shape in array_shapes(table).items():
            wide = [length for length in shape if length > 1]
            columns = min(wide) if len(wide) > 1 else 1
            names += [f"{name}[{k}]" for k in range(columns)] if columns > 1 else [name]
        return names


def _array_columns(table: Path, wanted: list[str]) -> list[FloatArray]:
    """Return columns (n,) of a file of arrays by name: ``NAME``, or ``NAME[k]``."""
    arrays: dict[str, FloatArray] = {}
    columns = []
    for name in wanted:
        whole, _, rest = name.partition("[")
        if whole not in arrays:
            arrays[whole] = read_array(table, whole)
        values, number = arrays[whole], rest.rstrip("]")
        if number.isdigit() and int(number) < values.shape[1]:
            columns.append(values[:, int(number)])
        elif rest or values.shape[1] > 1:
            last = values.shape[1] - 1
            raise UsageError(f"{table}: no column {name}; write {whole}[0] to [{last}]")
        else:
            columns.append(values[:, 0])
    return columns


@dataclass(frozen=True)
class ImportSummary:
    """Summary of an import: mean `rate`, Hz, and `duration`, s.

    `warnings`: on rows with impossible values, which were written as missing.
    """

    samples: int
    rate: float
    duration: float
    signals: tuple[str, ...]
    warnings: tuple[str, ...] = ()


def import_table(
    out: FilePath, columns: FilePath, *, robot_description: str | None = None, force: bool = False
) -> ImportSummary:
    """Write the table of a map as an MCAP bag with /joint_states, /joint_reference, /link_states.

    Parameters
    ----------
    out
        Path of the bag to write.
    columns
        The map (`TableMap`), YAML; `idim-iv init TABLE` proposes one.
    robot_description
        Text of the URDF, for /robot_description.
    force
        Replace a file that this program did not write.

    Raises
    ------
    UsageError
        No such file or column, a library that is not installed, or `out` cannot be written.
    DataError
        Columns of different lengths, stamps that do not increase, or more than a few rows that hold
        no possible value.
    """
    out = Path(out)
    if out.suffix.lower() != ".mcap":
        raise UsageError(f"{out}: the name of the bag must end in .mcap")
    require_file_place([out], force=force)
    described, table = read_map(columns)
    time, signals = mapped_columns(described, table)
    if len(time) < 2:
        raise DataError(f"{table}: {len(time)} samples: nothing to import")
    _require_stamps(time, str(table))
    joints, warnings = list(described.joints), []
    for name, values in signals.items():
        signals[name], sentence = without_impossible(
            _KINDS.get(name, name),
            values,
            joints,
            str(table),
            "mend the table or leave these rows out",
            table=True,
        )
        if sentence:
            warnings.append(f"{table}: {sentence}; imported as missing")
    topics = [
        JointTopic(topic, joints, time, *map(signals.get, columns_of))
        for topic, columns_of in _TOPICS.items()
        if columns_of[0] in signals
    ]
    write_bag(out, topics, robot_description=robot_description, force=force)
    duration = float(time[-1] - time[0])
    rate = (len(time) - 1) / duration
    return ImportSummary(len(time), rate, duration, tuple(signals), tuple(warnings))


def _require_stamps(time: FloatArray, source: str) -> None:
    """Raise DataError for stamps (n,) s that do not increase or are impossible."""
    if not np.isfinite(time).all():
        raise DataError(f"{source}: not every stamp is a number")
    behind = np.diff(time) <= 0.0
    if behind.any():
        row = int(np.argmax(behind)) + 1
        raise DataError(
            f"{source}: time does not advance at row {row} (counted from 0); remove rows that "
            "repeat a stamp, and sort the others by it"
        )
    if time[0] < 0.0 or time[-1] > _LAST_STAMP:
        raise DataError(
            f"{source}: stamps from {time[0]:.4g} s to {time[-1]:.4g} s; from 0 to "
            f"{_LAST_STAMP:.4g} s are possible: shift them, or look whether they are in s"
        )
    if np.any(np.diff(np.round(time * 1e9)) <= 0.0):
        raise DataError(f"{source}: stamps less than 1 ns apart; are they in s?")


def _signal_of(name: str) -> tuple[str, str] | None:
    """Return the signal and the joint that a column's name stands for; None if unclear."""
    kinds = {_kind(word) for word in _words(name)} - {None}
    if not kinds:
        return None
    signal = next(kind for kind in _WORDS if kind in kinds)
    if kinds >= {"reference", "velocity"}:
        signal = "velocity_reference"
    units = _UNITS_OF[_KINDS.get(signal, signal)]
    bare = _BRACKETS.sub(lambda text: "" if _matching_unit(text[1], units) else text[0], name)
    words = [word.lower() for word in _words(bare) if _kind(word) is None]
    return signal, "_".join(word for word in words if not _OF_ALL.fullmatch(word))


def _words(name: str) -> list[str]:
    """Return the words and numbers in a name, also of one like ``jointPosition1``."""
    return re.findall(r"[A-Za-z]+|\d+", re.sub(r"([a-z])([A-Z])", r"\1 \2", name))


def _kind(word: str) -> str | None:
    """Return the signal that a word of a name means; None for other words."""
    return next((kind for kind, words in _WORDS.items() if re.fullmatch(words, word, re.I)), None)


def proposed_map(table: Path) -> str:
    """Return the text of a proposed map, every key with a comment.

    Raises UsageError: no column is named like a position.
    """
    names = column_names(table)
    time = next((name for name in names if _TIME.match(name.rpartition("/")[2])), None)
    joints: dict[str, dict[str, str]] = {}
    unknown = []
    for name in names:
        signal_and_joint = None if name == time else _signal_of(name.rpartition("/")[2])
        if signal_and_joint is None:
            unknown += [name] if name != time else []
            continue
        signal, joint = signal_and_joint
        joints.setdefault(joint, {}).setdefault(signal, name)
    joints = {joint: columns for joint, columns in joints.items() if "position" in columns}
    if not joints:
        raise UsageError(
            f"{table}: no column is named like a position, there are {', '.join(names[:30])}; "
            "write a map by hand, see docs/commands.md"
        )
    lines = [
        "# Which column is what: correct it, then idim-iv import OUT.mcap --columns THIS_FILE",
        f"file: {_quote(table.name)}  # beside this map",
    ]
    decimal, iso = _text_format(table, time, [columns["position"] for columns in joints.values()])
    if time is None:
        lines.append("rate: 1000.0  # rows per second: no column is named like a time; CHECK")
    else:
        named = next((u for u, words in _UNITS if re.search(words, time, re.I)), "s")
        unit = "iso" if iso else named
        lines.append(f"time: {{column: {_quote(time)}, unit: {unit}}}  # s, ms, us, ns or iso")
    lines.append("joints:  # names as the URDF has them")
    for joint, columns in joints.items():
        shown = f"joint_{joint}" if joint.isdigit() else joint or "joint_1"
        pairs = ", ".join(f"{s}: {_quote(columns[s])}" for s in SIGNALS if s in columns)
        lines.append(f"  {shown}: {{{pairs}}}")
    position, velocity, effort = (
        _unit_in_names(units, [columns[signal] for columns in joints.values() if signal in columns])
        for signal, units in _UNITS_OF.items()
    )
    lines += [
        "units:",
        f"  position: {position}  # rad, deg, rev, m or mm; of references and link, too",
        f"  velocity: {velocity}  # rad/s, deg/s, rev/s, rpm, m/s or mm/s",
        f"  effort: {effort}  # N m, mN m, N, kN, A or mA",
    ]
    if table.suffix.lower() in TEXT:
        lines.append(
            f"decimal: '{decimal}'  # and where they are others, delimiter: ';' comment: '#'"
        )
    if unknown:
        lines.append(f"# Not used: {', '.join(unknown)}")
    return "\n".join(lines) + "\n"


def _text_format(table: Path, time: str | None, positions: list[str]) -> tuple[str, bool]:
    """Return the decimal sign by which positions are numbers, and whether stamps are ISO 8601."""

    def readable(decimal: str, columns: list[str], *, dates: bool = False) -> bool:
        text = TextTable(table, decimal=decimal)
        with suppress(DataError, UsageError):  # with another decimal sign other columns are cut
            numbers = [text.number(name) for name in columns]
            text.columns(numbers, numbers[0] if dates else None)
            return True
        return False

    if table.suffix.lower() not in TEXT:
        return ".", False
    decimal = next((sign for sign in (".", ",") if readable(sign, positions)), ".")
    iso = time is not None and not readable(decimal, [time])
    return decimal, iso and readable(decimal, [str(time)], dates=True)


def _unit_in_names(units: Mapping[str, float], names: list[str]) -> str:
    """Return the unit in brackets in a name, as in ``Pos J1 [deg]``; else the first of `units`."""
    for name in names:
        for text in _BRACKETS.findall(name):
            if unit := _matching_unit(text, units):
                return unit
    return next(iter(units))


def _matching_unit(text: str, units: Mapping[str, float]) -> str:
    """Return which of the units a text means, in any spelling; empty for none."""
    spelt = {unit.replace(" ", "").lower(): unit for unit in units} | {"°": "deg", "°/s": "deg/s"}
    unit = spelt.get(re.sub(r"[\s.·*]", "", text).lower(), "")
    return unit if unit in units else ""


def _quote(name: str) -> str:
    return "'" + name.replace("'", "''") + "'"
