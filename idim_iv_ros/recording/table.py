"""Import of tables: they are written as bags, which everything else reads."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.files import FilePath, require_file_place
from idim_iv_ros.recording.bags.joint_message_type import QUANTITIES
from idim_iv_ros.recording.bags.joint_messages import without_impossible
from idim_iv_ros.recording.table_map import mapped_columns, read_map
from idim_iv_ros.recording.writing.write import JointTopic, write_bag
from idim_iv_ros.types import FloatArray

# Stamps of ROS messages count seconds in 32 bits.
_LAST_STAMP = float(2**31 - 1)
_KINDS = {"reference": "position", "link": "position", "velocity_reference": "velocity"}


@dataclass(frozen=True)
class ImportSummary:
    """Summary of an import.

    `rate`, `duration`: mean rate in Hz, s. `warnings`: on rows with impossible values, which were
    written as missing.
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
        The map (`table_map.TableMap`), YAML; `idim-iv init TABLE` proposes one.
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
            row="row",
            first=0,
            missing=True,
        )
        if sentence:
            warnings.append(f"{table}: {sentence}; imported as missing")
    measured = {name: signals[name] for name in QUANTITIES if name in signals}
    topics = [JointTopic("/joint_states", joints, time, **measured)]
    if "reference" in signals:
        speeds = signals.get("velocity_reference")
        topics.append(JointTopic("/joint_reference", joints, time, signals["reference"], speeds))
    if "link" in signals:
        topics.append(JointTopic("/link_states", joints, time, signals["link"]))
    write_bag(out, topics, robot_description=robot_description, force=force)
    duration = float(time[-1] - time[0])
    rate = (len(time) - 1) / duration
    return ImportSummary(len(time), rate, duration, tuple(signals), tuple(warnings))


def _require_stamps(time: FloatArray, source: str) -> None:
    """Raise DataError for stamps (n,) s that do not increase or are impossible."""
    if not np.isfinite(time).all():
        raise DataError(f"{source}: not every stamp is a number")
    if np.any(np.diff(time) <= 0.0):
        row = int(np.argmax(np.diff(time) <= 0.0)) + 1
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
