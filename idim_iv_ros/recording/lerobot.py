"""Episodes of LeRobot data sets (versions 2 and 3) become bags of commands and positions."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.files import FilePath, read_text
from idim_iv_ros.recording.table import ImportSummary, require_bag_place, write_import
from idim_iv_ros.recording.table_file import parquet_columns
from idim_iv_ros.types import FloatArray

STATE, ACTION = "observation.state", "action"
_MOST = 12.0  # rad, beyond which no limited joint turns
_LARGEST = 10.0  # MB of info.json


def import_lerobot(
    out: FilePath,
    folder: FilePath,
    *,
    episode: int = 0,
    joints: Sequence[str] | None = None,
    scale: float = 1.0,
    robot_description: str | None = None,
    force: bool = False,
) -> ImportSummary:
    """Write one episode as an MCAP bag with /joint_states and /joint_reference.

    `out`: the bag. `folder`: of the data set, with meta/info.json and data/. `episode`: its number.
    `joints`: ``COLUMN`` or ``JOINT=COLUMN``: columns of the state by their names in the data set,
    and what the URDF calls them; None: all columns. A gripper is left out by not naming it.
    `scale`: what positions and commands are multiplied with to be in rad (0.0174533 for degrees).
    `robot_description`: text of the URDF, for /robot_description. `force`: replace a file that this
    program did not write.
    Raises UsageError: no such data set, episode or column, or pyarrow is not installed. DataError:
    positions that are no radians.
    """
    folder = Path(folder)
    out = require_bag_place(out, force=force)
    information = _information(folder)
    names = _names(folder, information)
    pairs = [(joint.partition("=")[0], joint.rpartition("=")[2]) for joint in joints or names]
    for _, column in pairs:
        if column not in names:
            raise UsageError(
                f"{folder}: no column {column} in {STATE}; there are {', '.join(names)}"
            )
    columns = [names.index(column) for _, column in pairs]
    files, filters = _files(folder, information, episode)
    read = [
        parquet_columns(files, key, filters=filters)
        for key in (STATE, ACTION, "timestamp", "frame_index")
    ]
    order = np.argsort(read[3][:, 0], kind="stable")
    state, action, time = (values[order] for values in read[:3])
    if len(state) < 2:
        raise UsageError(f"{folder}: episode {episode} holds {len(state)} frames")
    if action.shape[1] != state.shape[1]:
        raise UsageError(
            f"{folder}: {ACTION} has {action.shape[1]} columns and {STATE} {state.shape[1]}: "
            "actions that are no commanded positions cannot be compared with them"
        )
    position, command = scale * state[:, columns], scale * action[:, columns]
    for (joint, _), value in zip(pairs, np.abs(position).max(axis=0), strict=True):
        if not value <= _MOST:
            raise DataError(
                f"{folder}: {joint} is at {value:.4g}: no rad; give --scale 0.0174533 for degrees, "
                "or rad for a unit of a normalised range, from the calibration of the robot"
            )
    stamps, warnings = _stamps(time[:, 0], float(information["fps"]))
    signals = {"position": position, "reference": command}
    return write_import(
        out,
        [name for name, _ in pairs],
        stamps,
        signals,
        str(folder),
        warnings,
        robot_description=robot_description,
        force=force,
    )


def _information(folder: Path) -> dict[str, Any]:
    path = folder / "meta" / "info.json"
    text = read_text(path, "the description of the data set", megabytes=_LARGEST)
    try:
        information = json.loads(text)
        features, rate = information["features"], float(information["fps"])
        if not (rate > 0.0 and STATE in features and ACTION in features):
            raise KeyError(STATE)
    except (ValueError, KeyError, TypeError) as error:
        raise UsageError(
            f"{path}: a LeRobot data set with fps, {STATE} and {ACTION} is needed ({error})"
        ) from error
    return dict(information)


def _names(folder: Path, information: dict[str, Any]) -> list[str]:
    """Columns of the state; some data sets put their list into a mapping."""
    names = information["features"][STATE].get("names")
    if isinstance(names, dict) and len(names) == 1:
        names = next(iter(names.values()))
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise UsageError(f"{folder}: {STATE} has no names of its columns in meta/info.json")
    return names


def _files(
    folder: Path, information: dict[str, Any], episode: int
) -> tuple[list[Path], list[tuple[str, str, int]]]:
    """Files that may hold an episode, and what its rows have in common."""
    episodes = sorted((folder / "data").glob(f"*/episode_{episode:06d}.parquet"))
    files = episodes or sorted((folder / "data").glob("*/file-*.parquet"))
    if not files:
        raise UsageError(
            f"{folder}: no data of episode {episode}; there are "
            f"{information.get('total_episodes', 'no')} episodes, from 0"
        )
    return files, [("episode_index", "==", episode)]


def _stamps(time: FloatArray, rate: float) -> tuple[FloatArray, tuple[str, ...]]:
    """Times (n,) of frames, s, and what was assumed of them."""
    steps = np.diff(time)
    if np.all(steps > 0.0) and np.ptp(steps) > 1e-3 / rate:
        return time - time[0], ()
    return np.arange(len(time)) / rate, (
        f"the data set holds no measured times: frames are taken to be exactly {1e3 / rate:.4g} ms "
        "apart, and whatever jitter there was counts as noise",
    )
