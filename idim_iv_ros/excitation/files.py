"""The files of a motion: trajectory for the robot, table and figures for people; all or none."""

import io
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from idim_iv_ros.errors import UsageError
from idim_iv_ros.excitation.joint_trajectory import write_joint_trajectory
from idim_iv_ros.excitation.trajectory import Trajectory, write_csv
from idim_iv_ros.files import (
    FILES,
    FilePath,
    as_file,
    digests,
    probe_place,
    require_replaceable,
    write_together,
)

ENDINGS = ("csv", "yaml", "json")


def motion_stem(out: FilePath) -> Path:
    """Path without ending that the files of a motion share: ``run.csv`` and ``run`` alike.

    Raises
    ------
    UsageError
        `out` has no name.
    """
    out = as_file(out)
    return out.with_suffix("") if out.suffix in (".csv", ".yaml", ".json") else out


@contextmanager
def require_place(
    out: FilePath, endings: Sequence[str] = ENDINGS, *, force: bool = False
) -> Iterator[None]:
    """Make sure, before long work, that the files of a motion can be written afterwards.

    Parameters
    ----------
    out
        Stem, or one of the files.
    endings
        Of the files that will be written.
    force
        Replace files that this program did not write.

    Raises
    ------
    UsageError
        The folder of `out` is missing or cannot be written, `out` is a folder, or as
        `require_replaceable`.
    """
    out = Path(out)
    stem = motion_stem(out)
    require_replaceable(_files(stem, endings), force=force)
    try:
        if not stem.name or stem.is_dir():
            raise IsADirectoryError(f"{out} is a folder")
        probe_place(stem)
    except OSError as error:
        raise _refusal(out, error) from error
    yield


def write_motion(
    out: FilePath,
    trajectory: Trajectory,
    document: Mapping[str, object],
    *,
    message_rate: float,
    tables: Mapping[str, str] | None = None,
    force: bool = False,
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
    force
        Replace files that this program did not write.

    Returns
    -------
    tuple of Path
        The files, in this order.

    Raises
    ------
    UsageError
        A file cannot be written, or must not be replaced; none is then left behind.
    """
    out = Path(out)
    stem = motion_stem(out)
    table, message = io.StringIO(), io.StringIO()
    write_csv(trajectory, table)
    write_joint_trajectory(trajectory, message, rate=message_rate)
    texts = {"csv": table.getvalue(), "yaml": message.getvalue(), "json": "", **(tables or {})}
    paths = dict(zip(_files(stem, texts), texts.values(), strict=True))
    beside = {path.name: text for path, text in paths.items() if path.suffix != ".json"}
    complete = {**document, FILES: digests(beside)}
    text = json.dumps(complete, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    paths[_files(stem, ["json"])[0]] = text
    require_replaceable(paths, force=force)
    try:
        write_together(paths)
    except OSError as error:
        raise _refusal(out, error) from error
    return tuple(paths)


def _files(stem: Path, endings: Iterable[str]) -> list[Path]:
    return [stem.with_name(f"{stem.name}.{ending}") for ending in endings]


def _refusal(out: Path, error: OSError) -> UsageError:
    reason = error.strerror or str(error)
    return UsageError(f"{out}: cannot write the trajectory there: {reason}; give another --out")
