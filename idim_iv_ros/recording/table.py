"""Tables of any format become bags, so that everything enters by the same door."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.files import FilePath, require_file_place
from idim_iv_ros.recording.bags.joint_message_type import QUANTITIES
from idim_iv_ros.recording.plausible import without_impossible
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

    `rate`, `duration`: mean rate in Hz, s. `warnings`: rows that hold no possible value, and were
    written as missing; what was assumed.
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
    if (rate is None) == (time is None):
        raise UsageError("give either --rate or --time")
    if rate is not None and not (np.isfinite(rate) and rate > 0.0):
        raise UsageError(f"--rate {rate:g}: a positive number of samples per second is needed")
    if reference is None and (velocity_reference is not None or reference_time is not None):
        raise UsageError("--velocity-reference and --reference-time need --reference")
    out = require_bag_place(out, joints, force=force)
    given = {
        "position": position,
        "effort": effort,
        "velocity": velocity,
        "reference": reference,
        "velocity_reference": velocity_reference,
        "link": link,
    }
    tables = {name: os.fspath(spec) for name, spec in given.items() if spec is not None}
    signals = {name: read_table(spec) for name, spec in tables.items()}
    for name, values in signals.items():
        if values.shape[1] != len(joints):
            raise UsageError(f"{tables[name]}: {values.shape[1]} columns for {len(joints)} joints")
    stamps = _stamps(time, rate, len(signals["position"]), tables["position"])
    reference_stamps, warnings = stamps, []
    if reference is not None:
        samples = len(signals["reference"])
        if reference_time is not None:
            reference_stamps = _stamps(reference_time, None, samples, tables["reference"])
        elif rate is not None and samples != len(stamps):
            warnings.append(
                f"{tables['reference']}: {samples} samples, but {len(stamps)} of the "
                "measurements; both are taken to begin at the same instant, with the same rate"
            )
            reference_stamps = _stamps(None, rate, samples, tables["reference"])
    for name, values in signals.items():
        of_reference = name in ("reference", "velocity_reference")
        there = reference_stamps if of_reference else stamps
        if len(values) != len(there):
            other = tables["reference" if name == "velocity_reference" else "position"]
            raise DataError(f"{tables[name]}: {len(values)} samples, but {len(there)} in {other}")
    return write_import(
        out,
        joints,
        (stamps, reference_stamps),
        signals,
        tables,
        warnings,
        robot_description=robot_description,
        force=force,
    )


def import_mapped(
    out: FilePath, columns: FilePath, *, robot_description: str | None = None, force: bool = False
) -> ImportSummary:
    """Write the table of a map (`table_map.TableMap`) as an MCAP bag with the same topics.

    `out`: the bag. `columns`: the map, YAML. `robot_description`: text of the URDF, for
    /robot_description. `force`: replace a file that this program did not write.
    Raises UsageError: no such file or column, a library that is not installed, or `out` cannot be
    written. DataError: as `import_table`.
    """
    described, table = read_map(columns)
    joints = list(described.joints)
    out = require_bag_place(out, joints, force=force)
    time, signals = mapped_columns(described, table)
    source, samples = str(table), len(signals["position"])
    if time is None:
        stamps = _stamps(None, described.rate, samples, source)
    else:
        stamps = _checked_stamps(time, source, samples, source)
    return write_import(
        out,
        joints,
        (stamps, stamps),
        signals,
        dict.fromkeys(signals, source),
        robot_description=robot_description,
        force=force,
    )


def require_bag_place(out: FilePath, joints: Sequence[str], *, force: bool) -> Path:
    """Refuse a bag that cannot be written, and names that no message can hold.

    Raises UsageError: one line with the bag or the name.
    """
    out = Path(out)
    if out.suffix.lower() != ".mcap":
        raise UsageError(f"{out}: the name of the bag must end in .mcap")
    require_file_place([out], force=force)
    for joint in joints:
        try:
            joint.encode()
        except UnicodeEncodeError as error:  # bytes of the command line that are not UTF-8
            raise UsageError(f"joint {joint!a}: the name is not text in UTF-8") from error
    return out


def write_import(
    out: Path,
    joints: Sequence[str],
    stamps: tuple[FloatArray, FloatArray],
    signals: Mapping[str, FloatArray],
    sources: Mapping[str, str],
    warnings: Sequence[str] = (),
    *,
    robot_description: str | None,
    force: bool,
) -> ImportSummary:
    """Write the topics of an import, rows that hold no possible value as missing.

    `stamps`: (n,) s of the measurements and of the references. `signals`: (n, n_joints) of
    `table_map.SIGNALS`. `sources`: what the table of each signal is called.
    """
    possible, warnings = {}, list(warnings)
    for name, values in signals.items():
        possible[name], sentence = without_impossible(
            _KINDS.get(name, name),
            values,
            joints,
            sources[name],
            "mend the table or leave these rows out",
            row="row",
            first=0,
            missing=True,
        )
        if sentence:
            warnings.append(f"{sources[name]}: {sentence}; imported as missing")
    signals, (time, reference_time) = possible, stamps
    measured = {name: signals[name] for name in QUANTITIES if name in signals}
    topics = [JointTopic("/joint_states", joints, time, **measured)]
    if "reference" in signals:
        topics.append(
            JointTopic(
                "/joint_reference",
                joints,
                reference_time,
                position=signals["reference"],
                velocity=signals.get("velocity_reference"),
            )
        )
    if "link" in signals:
        topics.append(JointTopic("/link_states", joints, time, position=signals["link"]))
    write_bag(out, topics, robot_description=robot_description, force=force)
    duration = float(time[-1] - time[0])
    rate = (len(time) - 1) / duration
    return ImportSummary(len(time), rate, duration, tuple(signals), tuple(warnings))


def _stamps(time: FilePath | None, rate: float | None, samples: int, source: str) -> FloatArray:
    """Stamps (samples,) s of the rows of `source`, from a table or at a rate."""
    if time is not None:
        time = os.fspath(time)
        stamps = read_table(time)
        if stamps.shape[1] != 1:
            raise UsageError(f"{time}: one column of time stamps is needed, not {stamps.shape[1]}")
        return _checked_stamps(stamps[:, 0], time, samples, source)
    assert rate is not None
    _require_samples(samples, source)
    with np.errstate(over="ignore"):
        last = float(np.divide(samples - 1, rate))
    if last > _LAST_STAMP or rate > 1e9:
        raise UsageError(
            f"--rate {rate:g}: {samples} samples would take {last:.3g} s; give samples per second"
        )
    return np.arange(samples) / rate


def _checked_stamps(stamps: FloatArray, time: str, samples: int, source: str) -> FloatArray:
    """Refuse stamps (n,) that no recording has; `time`, `source`: where both come from."""
    _require_samples(samples, source)
    if len(stamps) != samples:
        raise DataError(f"{time}: {len(stamps)} stamps for {samples} samples of {source}")
    if not np.isfinite(stamps).all():
        raise DataError(f"{time}: not every stamp is a number")
    if np.any(np.diff(stamps) <= 0.0):
        row = int(np.argmax(np.diff(stamps) <= 0.0)) + 1
        raise DataError(
            f"{time}: time does not advance at row {row} (counted from 0); remove rows that repeat "
            "a stamp, and sort the others by it"
        )
    if stamps[0] < 0.0 or stamps[-1] > _LAST_STAMP:
        raise DataError(
            f"{time}: stamps from {stamps[0]:.4g} s to {stamps[-1]:.4g} s; from 0 to "
            f"{_LAST_STAMP:.4g} s are possible: shift them, or look whether they are in s"
        )
    if np.any(np.diff(np.round(stamps * 1e9)) <= 0.0):
        raise DataError(f"{time}: stamps less than 1 ns apart; are they in s?")
    return np.asarray(stamps)


def _require_samples(samples: int, source: str) -> None:
    """Refuse so few rows that there is no rate."""
    if samples < 2:
        raise DataError(f"{source}: {samples} samples: nothing to import")
