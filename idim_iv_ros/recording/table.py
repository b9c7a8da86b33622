"""Tables (.csv .npy .npz .mat) become bags, so that everything enters by the same door."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.atomic_files import require_file_place
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.file_paths import FilePath
from idim_iv_ros.recording.write import JointTopic, write_bag

FloatArray = NDArray[np.float64]

_SUFFIXES = (".csv", ".npy", ".npz", ".mat")


@dataclass(frozen=True)
class ImportSummary:
    """What was imported.

    Attributes
    ----------
    samples : int
    rate, duration : float
        Mean rate in Hz, s.
    signals : tuple of str
    """

    samples: int
    rate: float
    duration: float
    signals: tuple[str, ...]


def import_table(
    out: FilePath,
    *,
    joints: Sequence[str] | str,
    position: FilePath,
    effort: FilePath,
    rate: float | None = None,
    time: FilePath | None = None,
    velocity: FilePath | None = None,
    reference: FilePath | None = None,
    velocity_reference: FilePath | None = None,
    reference_time: FilePath | None = None,
    robot_description: str | None = None,
    force: bool = False,
) -> ImportSummary:
    """Write tables as an MCAP bag with /joint_states and /joint_reference.

    Each signal is ``FILE`` or ``FILE:KEY``; KEY is a variable, or comma-separated columns.

    Parameters
    ----------
    out
        The bag.
    joints
        Names for the columns; one name for one column.
    rate, time
        Samples per second, or the stamps in s; one of the two.
    reference_time
        Stamps of the references where they are not those of the measurements.
    robot_description
        Text of the URDF, for /robot_description.
    force
        Replace a file that this program did not write.

    Raises
    ------
    UsageError
        A file, variable or column that does not exist, or `out` cannot be written.
    DataError
        Lengths that do not fit, or stamps that do not increase.
    """
    out = Path(out)
    joints = [joints] if isinstance(joints, str) else list(joints)
    position, effort = os.fspath(position), os.fspath(effort)
    time, velocity, reference, velocity_reference, reference_time = (
        None if given is None else os.fspath(given)
        for given in (time, velocity, reference, velocity_reference, reference_time)
    )
    if (rate is None) == (time is None):
        raise UsageError("give either --rate or --time")
    if rate is not None and not (np.isfinite(rate) and rate > 0.0):
        raise UsageError(f"--rate {rate:g}: a positive number of samples per second is needed")
    if out.suffix != ".mcap":
        raise UsageError(f"{out}: the name of the bag must end in .mcap")
    require_file_place([out], force=force)
    measured = {"position": position, "effort": effort}
    if velocity is not None:
        measured["velocity"] = velocity
    columns = {name: _joint_columns(spec, joints) for name, spec in measured.items()}
    stamps = _stamps(time, rate, columns["position"], position)
    for name, values in columns.items():
        _require_length(values, stamps, measured[name], position)
    topics = [JointTopic("/joint_states", joints, stamps, **columns)]
    if reference is not None:
        topics.append(
            _reference_topic(joints, reference, velocity_reference, reference_time, stamps, rate)
        )
    elif velocity_reference is not None or reference_time is not None:
        raise UsageError("--velocity-reference and --reference-time need --reference")
    write_bag(out, topics, robot_description=robot_description, force=force)
    duration = float(stamps[-1] - stamps[0])
    signals = tuple(measured) + (() if reference is None else ("reference",))
    return ImportSummary(len(stamps), (len(stamps) - 1) / duration, duration, signals)


def _reference_topic(
    joints: Sequence[str],
    reference: str,
    velocity: str | None,
    time: str | None,
    stamps: FloatArray,
    rate: float | None,
) -> JointTopic:
    position = _joint_columns(reference, joints)
    if time is not None:
        stamps = _stamps(time, None, position, reference)
    elif rate is not None and len(position) != len(stamps):
        stamps = np.arange(len(position)) / rate
    _require_length(position, stamps, reference, "the time stamps")
    speed = None if velocity is None else _joint_columns(velocity, joints)
    if speed is not None:
        _require_length(speed, stamps, velocity or "", reference)
    return JointTopic("/joint_reference", joints, stamps, position=position, velocity=speed)


def _stamps(time: str | None, rate: float | None, position: FloatArray, source: str) -> FloatArray:
    if len(position) < 2:
        raise DataError(f"{source}: {len(position)} samples: nothing to import")
    if time is None:
        assert rate is not None
        return np.arange(len(position)) / rate
    stamps = _read(time)
    if stamps.shape[1] != 1:
        raise UsageError(f"{time}: one column of time stamps is needed, not {stamps.shape[1]}")
    stamps = stamps[:, 0]
    if len(stamps) != len(position):
        raise DataError(f"{time}: {len(stamps)} stamps for {len(position)} samples of {source}")
    if not np.isfinite(stamps).all():
        raise DataError(f"{time}: not every stamp is a number")
    if np.any(np.diff(stamps) <= 0.0):
        row = int(np.argmax(np.diff(stamps) <= 0.0)) + 1
        raise DataError(f"{time}: time does not advance at sample {row}")
    return np.asarray(stamps)


def _require_length(values: FloatArray, stamps: FloatArray, source: str, other: str) -> None:
    if len(values) != len(stamps):
        raise DataError(f"{source}: {len(values)} samples, but {len(stamps)} in {other}")


def _joint_columns(spec: str, joints: Sequence[str]) -> FloatArray:
    values = _read(spec)
    if values.shape[1] != len(joints):
        raise UsageError(f"{spec}: {values.shape[1]} columns for {len(joints)} joints")
    return values


def _read(spec: str) -> FloatArray:
    """Two-dimensional numbers (n_samples, n_columns) of ``FILE[:KEY]``."""
    path, key = _split(spec)
    try:
        values = _load(path, key)
    except UsageError:
        raise
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (ValueError, KeyError, TypeError, NotImplementedError, EOFError) as error:
        reason = " ".join(str(error).split())
        raise UsageError(f"{path}: not a table that can be read: {reason}") from error
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise UsageError(f"{spec}: holds something else than numbers") from error
    if array.ndim == 1:
        array = array[:, None]
    if array.ndim != 2:
        raise UsageError(f"{spec}: {array.ndim} dimensions; samples and joints are needed")
    return array if array.shape[0] >= array.shape[1] else array.T


def _split(spec: str) -> tuple[Path, str | None]:
    if Path(spec).is_file():
        return Path(spec), None
    name, colon, key = spec.rpartition(":")
    path = Path(name if colon else spec)
    if not path.is_file():
        raise UsageError(f"{path}: no such file")
    if path.suffix.lower() not in _SUFFIXES:
        raise UsageError(f"{path}: not a table ({', '.join(_SUFFIXES)})")
    return path, key


def _load(path: Path, key: str | None) -> Any:
    suffix = path.suffix.lower()
    if suffix not in _SUFFIXES:
        raise UsageError(f"{path}: not a table ({', '.join(_SUFFIXES)})")
    if suffix == ".csv":
        return _csv(path, key)
    if suffix == ".npy":
        array = np.load(path, allow_pickle=False)
        if key is None:
            return array
        return array[:, [int(column) for column in key.split(",")]]
    if suffix == ".npz":
        with np.load(path, allow_pickle=False) as archive:
            variables = {name: archive[name] for name in archive.files}
    else:
        from scipy.io import loadmat  # here, because a recorder starts faster without it

        variables = {k: v for k, v in loadmat(path).items() if not k.startswith("__")}
    if key is None and len(variables) == 1:
        return next(iter(variables.values()))
    names = ", ".join(sorted(variables))
    if key is None:
        raise UsageError(f"{path}: say which variable, FILE:KEY; there are {names}")
    if key in variables:
        return variables[key]
    parts = key.split(",")
    for part in parts:
        if part not in variables:
            raise UsageError(f"{path}: no variable {part}; there are {names}")
    return np.column_stack([np.ravel(variables[part]) for part in parts])


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
            if headed and column in names:
                wanted.append(names.index(column))
            elif column.isdigit() and int(column) < len(names):
                wanted.append(int(column))
            else:
                raise UsageError(f"{path}: no column {column}; there are {', '.join(names)}")
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
