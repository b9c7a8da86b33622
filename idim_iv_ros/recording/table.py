"""Tables (.csv .npy .npz .mat .parquet) become bags, so that everything enters by the same door."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.files import FilePath, require_file_place
from idim_iv_ros.recording.plausible import impossible, wrong_rows
from idim_iv_ros.recording.table_file import read_table
from idim_iv_ros.recording.table_map import mapped_columns, read_map
from idim_iv_ros.recording.writing.write import JointTopic, write_bag
from idim_iv_ros.types import FloatArray

# Stamps of ROS messages count seconds in 32 bits.
_LAST_STAMP = float(2**31 - 1)
_KINDS = {"reference": "position", "link": "position", "velocity_reference": "velocity"}


@dataclass(frozen=True)
class ImportSummary:
    """What was imported.

    Attributes
    ----------
    samples : int
    rate, duration : float
        Mean rate in Hz, s.
    signals : tuple of str
    warnings : tuple of str
        Rows that hold no possible value, and were written as missing; what was assumed.
    """

    samples: int
    rate: float
    duration: float
    signals: tuple[str, ...]
    warnings: tuple[str, ...] = ()


def import_table(
    out: FilePath,
    *,
    joints: Sequence[str] | str,
    position: FilePath,
    effort: FilePath | None = None,
    rate: float | None = None,
    time: FilePath | None = None,
    velocity: FilePath | None = None,
    reference: FilePath | None = None,
    velocity_reference: FilePath | None = None,
    reference_time: FilePath | None = None,
    link: FilePath | None = None,
    robot_description: str | None = None,
    force: bool = False,
) -> ImportSummary:
    """Write tables as an MCAP bag with /joint_states, /joint_reference and /link_states.

    Each signal is ``FILE`` or ``FILE:KEY``; KEY is a variable, or comma-separated columns: names of
    a header line, or numbers from 0.

    Parameters
    ----------
    out
        The bag.
    joints
        Names for the columns; one name for one column.
    effort
        None for a robot that records none.
    rate, time
        Samples per second, or the stamps in s; one of the two.
    reference_time
        Stamps of the references where they are not those of the measurements.
    link
        Positions of encoders behind the gears, at the stamps of the measurements.
    robot_description
        Text of the URDF, for /robot_description.
    force
        Replace a file that this program did not write.

    Raises
    ------
    UsageError
        A file, variable or column that does not exist, or `out` cannot be written.
    DataError
        Lengths that do not fit, stamps that do not increase, or more than a few rows that hold no
        possible value.
    """
    joints = [joints] if isinstance(joints, str) else list(joints)
    position = os.fspath(position)
    time, effort, velocity, reference, velocity_reference, reference_time = (
        None if given is None else os.fspath(given)
        for given in (time, effort, velocity, reference, velocity_reference, reference_time)
    )
    if (rate is None) == (time is None):
        raise UsageError("give either --rate or --time")
    if rate is not None and not (np.isfinite(rate) and rate > 0.0):
        raise UsageError(f"--rate {rate:g}: a positive number of samples per second is needed")
    out = _require_bag(out, joints, force=force)
    measured = {"position": position}
    if effort is not None:
        measured["effort"] = effort
    if velocity is not None:
        measured["velocity"] = velocity
    warnings: list[str] = []
    columns = {
        name: _joint_columns(name, spec, joints, warnings) for name, spec in measured.items()
    }
    stamps = _stamps(time, rate, columns["position"], position)
    for name, values in columns.items():
        _require_length(values, stamps, measured[name], position)
    topics = [JointTopic("/joint_states", joints, stamps, **columns)]
    if reference is not None:
        topics.append(
            _reference_topic(
                joints, (reference, velocity_reference, reference_time), stamps, rate, warnings
            )
        )
    elif velocity_reference is not None or reference_time is not None:
        raise UsageError("--velocity-reference and --reference-time need --reference")
    if link is not None:
        behind = _joint_columns("position", os.fspath(link), joints, warnings)
        _require_length(behind, stamps, os.fspath(link), position)
        topics.append(JointTopic("/link_states", joints, stamps, position=behind))
    write_bag(out, topics, robot_description=robot_description, force=force)
    signals = tuple(measured) + (() if reference is None else ("reference",))
    signals += () if link is None else ("link",)
    return _summary(stamps, signals, warnings)


def import_mapped(
    out: FilePath,
    columns: FilePath,
    *,
    robot_description: str | None = None,
    force: bool = False,
) -> ImportSummary:
    """Write the table of a map (`table_map.TableMap`) as an MCAP bag with the same topics.

    Parameters
    ----------
    out
        The bag.
    columns
        The map, YAML.
    robot_description
        Text of the URDF, for /robot_description.
    force
        Replace a file that this program did not write.

    Raises
    ------
    UsageError
        No such file or column, a library that is not installed, or `out` cannot be written.
    DataError
        As `import_table`.
    """
    described, table = read_map(columns)
    joints = list(described.joints)
    out = _require_bag(out, joints, force=force)
    time, signals = mapped_columns(described, table)
    warnings: list[str] = []
    source = str(table)
    possible = {
        name: _possible(_KINDS.get(name, name), values, source, joints, warnings)
        for name, values in signals.items()
    }
    position = possible["position"]
    if time is None:
        assert described.rate is not None
        stamps = _stamps(None, described.rate, position, source)
    else:
        stamps = _checked_stamps(time, source, position, source)
    measured = {n: possible[n] for n in ("position", "velocity", "effort") if n in possible}
    topics = [JointTopic("/joint_states", joints, stamps, **measured)]
    if "reference" in possible:
        topics.append(
            JointTopic(
                "/joint_reference",
                joints,
                stamps,
                position=possible["reference"],
                velocity=possible.get("velocity_reference"),
            )
        )
    if "link" in possible:
        topics.append(JointTopic("/link_states", joints, stamps, position=possible["link"]))
    write_bag(out, topics, robot_description=robot_description, force=force)
    return _summary(stamps, tuple(possible), warnings)


def _require_bag(out: FilePath, joints: Sequence[str], *, force: bool) -> Path:
    """Refuse a bag that cannot be written, and names that no message can hold."""
    out = Path(out)
    if out.suffix.lower() != ".mcap":
        raise UsageError(f"{out}: the name of the bag must end in .mcap")
    require_file_place([out], force=force)
    _require_text(joints)
    return out


def _summary(
    stamps: FloatArray, signals: tuple[str, ...], warnings: Sequence[str]
) -> ImportSummary:
    duration = float(stamps[-1] - stamps[0])
    rate = (len(stamps) - 1) / duration
    return ImportSummary(len(stamps), rate, duration, signals, tuple(warnings))


def _require_text(joints: Sequence[str]) -> None:
    """Refuse names that no message can hold: bytes of the command line that are not UTF-8."""
    for joint in joints:
        try:
            joint.encode()
        except UnicodeEncodeError as error:
            raise UsageError(f"joint {joint!a}: the name is not text in UTF-8") from error


def _reference_topic(
    joints: Sequence[str],
    sources: tuple[str, str | None, str | None],
    stamps: FloatArray,
    rate: float | None,
    warnings: list[str],
) -> JointTopic:
    """Topic of the references: position, velocity and stamps come from `sources`."""
    reference, velocity, time = sources
    position = _joint_columns("position", reference, joints, warnings)
    if time is not None:
        stamps = _stamps(time, None, position, reference)
    elif rate is not None and len(position) != len(stamps):
        warnings.append(
            f"{reference}: {len(position)} samples, but {len(stamps)} of the measurements; both "
            "are taken to begin at the same instant, with the same rate"
        )
        stamps = _stamps(None, rate, position, reference)
    _require_length(position, stamps, reference, "the time stamps")
    speed = None
    if velocity is not None:
        speed = _joint_columns("velocity", velocity, joints, warnings)
        _require_length(speed, stamps, velocity, reference)
    return JointTopic("/joint_reference", joints, stamps, position=position, velocity=speed)


def _stamps(time: str | None, rate: float | None, position: FloatArray, source: str) -> FloatArray:
    if len(position) < 2:
        raise DataError(f"{source}: {len(position)} samples: nothing to import")
    if time is None:
        assert rate is not None
        return _regular_stamps(len(position), rate)
    stamps = read_table(time)
    if stamps.shape[1] != 1:
        raise UsageError(f"{time}: one column of time stamps is needed, not {stamps.shape[1]}")
    return _checked_stamps(stamps[:, 0], time, position, source)


def _checked_stamps(stamps: FloatArray, time: str, position: FloatArray, source: str) -> FloatArray:
    """Refuse stamps (n,) that no recording has; `time`, `source`: where both come from."""
    if len(stamps) != len(position):
        raise DataError(f"{time}: {len(stamps)} stamps for {len(position)} samples of {source}")
    if not np.isfinite(stamps).all():
        raise DataError(f"{time}: not every stamp is a number")
    if np.any(np.diff(stamps) <= 0.0):
        row = int(np.argmax(np.diff(stamps) <= 0.0)) + 1
        raise DataError(f"{time}: time does not advance at row {row} (counted from 0)")
    if stamps[0] < 0.0 or stamps[-1] > _LAST_STAMP:
        raise DataError(
            f"{time}: stamps from {stamps[0]:.4g} s to {stamps[-1]:.4g} s; from 0 to "
            f"{_LAST_STAMP:.4g} s are possible: shift them, or look whether they are in s"
        )
    if np.any(np.diff(np.round(stamps * 1e9)) <= 0.0):
        raise DataError(f"{time}: stamps less than 1 ns apart; are they in s?")
    return np.asarray(stamps)


def _regular_stamps(samples: int, rate: float) -> FloatArray:
    with np.errstate(over="ignore"):
        last = float(np.divide(samples - 1, rate))
    if last > _LAST_STAMP or rate > 1e9:
        raise UsageError(
            f"--rate {rate:g}: {samples} samples would take {last:.3g} s; give samples per second"
        )
    return np.arange(samples) / rate


def _require_length(values: FloatArray, stamps: FloatArray, source: str, other: str) -> None:
    if len(values) != len(stamps):
        raise DataError(f"{source}: {len(values)} samples, but {len(stamps)} in {other}")


def _joint_columns(name: str, spec: str, joints: Sequence[str], warnings: list[str]) -> FloatArray:
    """Columns of the joints, NaN and a warning where a few rows hold no possible `name`.

    Raises
    ------
    UsageError
        Another number of columns.
    DataError
        More than a few such rows.
    """
    values = read_table(spec)
    if values.shape[1] != len(joints):
        raise UsageError(f"{spec}: {values.shape[1]} columns for {len(joints)} joints")
    return _possible(name, values, spec, joints, warnings)


def _possible(
    name: str, values: FloatArray, spec: str, joints: Sequence[str], warnings: list[str]
) -> FloatArray:
    """Values with NaN, and a warning, where a few rows hold no possible `name`."""
    wrong = wrong_rows(name, values, joints, missing=True)
    if wrong is None:
        return values
    sentence = f"{spec}: {name}: {wrong.sentence('row', 0)}"
    if wrong.too_many:
        raise DataError(f"{sentence}; mend the table or leave these rows out")
    warnings.append(f"{sentence}; imported as missing")
    return np.where(impossible(name, values), np.nan, values)
