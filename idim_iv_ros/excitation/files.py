"""The files of a motion: trajectory for the robot, table and figures for people; all or none."""

import io
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from idim_iv_ros.atomic_files import probe_place, write_together
from idim_iv_ros.errors import UsageError
from idim_iv_ros.excitation.joint_trajectory import write_joint_trajectory
from idim_iv_ros.excitation.trajectory import Trajectory, write_csv


def motion_stem(out: Path) -> Path:
    """Path without ending that the files of a motion share: ``run.csv`` and ``run`` alike."""
    return out.with_suffix("") if out.suffix in (".csv", ".yaml", ".json") else out


@contextmanager
def require_place(out: Path) -> Iterator[None]:
    """Make sure, before long work, that the files of a motion can be written afterwards.

    Raises
    ------
    UsageError
        The folder of `out` is missing or cannot be written, or `out` is a folder.
    """
    stem = motion_stem(out)
    try:
        if not stem.name or stem.is_dir():
            raise IsADirectoryError(f"{out} is a folder")
        probe_place(stem)
    except OSError as error:
        raise _refusal(out, error) from error
    yield


def write_motion(
    out: Path,
    trajectory: Trajectory,
    document: Mapping[str, object],
    *,
    message_rate: float,
    tables: Mapping[str, str] | None = None,
) -> tuple[Path, ...]:
    """Write ``STEM.csv``, ``STEM.yaml``, ``STEM.json`` and further tables ``STEM.<key>``.

    All are written beside their place and moved there when they are complete.

    Parameters
    ----------
    out
        Stem, or one of the files.
    document
        Figures, for JSON.
    message_rate
        Points per second of the JointTrajectory.
    tables
        Text of further files by their ending, e.g. ``segments.csv``.

    Returns
    -------
    tuple of Path
        The files, in this order.

    Raises
    ------
    UsageError
        A file cannot be written; none is then left behind.
    """
    stem = motion_stem(out)
    table, message = io.StringIO(), io.StringIO()
    write_csv(trajectory, table)
    write_joint_trajectory(trajectory, message, rate=message_rate)
    text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    texts = {"csv": table.getvalue(), "yaml": message.getvalue(), "json": text, **(tables or {})}
    paths = {stem.with_name(f"{stem.name}.{ending}"): text for ending, text in texts.items()}
    try:
        write_together(paths)
    except OSError as error:
        raise _refusal(out, error) from error
    return tuple(paths)


def _refusal(out: Path, error: OSError) -> UsageError:
    reason = error.strerror or str(error)
    return UsageError(f"{out}: cannot write the trajectory there: {reason}; give another --out")
