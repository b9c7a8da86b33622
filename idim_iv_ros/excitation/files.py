"""The files of a motion, all or none.

``.csv``, the trajectory; ``.yaml``, a trajectory_msgs/msg/JointTrajectory for ``ros2 topic pub``;
``.json``, its figures.
"""

import io
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TextIO

import numpy as np

from idim_iv_ros.encoding import json_text
from idim_iv_ros.errors import UsageError
from idim_iv_ros.excitation.diagnosis import Diagnosis
from idim_iv_ros.excitation.limits import LimitUse, MotionLimits
from idim_iv_ros.excitation.segments import NOT_REVEALED
from idim_iv_ros.excitation.trajectory import Trajectory, write_csv
from idim_iv_ros.files import (
    FILES,
    FilePath,
    as_file,
    digests,
    refused_if_unwritable,
    require_file_place,
    require_replaceable,
    write_together,
)

FORMAT = "idim_iv_ros/excitation/1"
_OF_SEGMENTS = ("name", "kind", "start", "end", "effects", "speed", "amplitude", "frequency")


def require_place(out: FilePath, *, force: bool = False) -> None:
    """Make sure, before long work, that the files of a motion can be written afterwards.

    `out` is their stem, or one of them; `force` replaces files that this program did not write.

    Raises UsageError: `out` is a folder or has no name, or as `require_file_place`.
    """
    if Path(out).is_dir():
        raise UsageError(f"{out} is a folder; give another --out")
    require_file_place(_files(out), force=force)


def write_motion(
    out: FilePath,
    trajectory: Trajectory,
    document: Mapping[str, object],
    *,
    message_rate: float,
    force: bool = False,
) -> tuple[Path, ...]:
    """Write ``STEM.csv``, ``STEM.yaml`` and ``STEM.json``; return their paths in this order.

    `out` and `force` as in `require_place`; `document`: figures, for JSON; `message_rate`: points
    per second of the JointTrajectory.

    Raises UsageError: a file cannot be written, or must not be replaced; none is then left behind.
    """
    table, message = io.StringIO(), io.StringIO()
    write_csv(trajectory, table)
    write_joint_trajectory(trajectory, message, rate=message_rate)
    table_file, message_file, figures = paths = _files(out)
    texts = {table_file: table.getvalue(), message_file: message.getvalue()}
    signed = digests({path.name: text for path, text in texts.items()})
    require_replaceable(paths, force=force)
    with refused_if_unwritable(out):
        write_together({**texts, figures: json_text({**document, FILES: signed})})
    return paths


def write_joint_trajectory(trajectory: Trajectory, file: TextIO, *, rate: float) -> None:
    """Write the message; its points are every k-th sample and the last one.

    ``ros2 topic pub --once --yaml-file FILE TOPIC trajectory_msgs/msg/JointTrajectory`` and
    ``"$(cat FILE)"`` accept the text. A joint_trajectory_controller interpolates between the
    points (quintic splines where points have accelerations, as here).

    - `rate`: points per second; the nearest that divides the trajectory's rate is used

    Raises UsageError: `rate` is not between 0 and the rate of the trajectory.
    """
    if not 0.0 < rate <= trajectory.rate:
        raise UsageError(
            f"{rate:g} points per second: a rate above 0 and up to that of the trajectory, "
            f"{trajectory.rate:g} per second, is needed"
        )
    file.write("header: {stamp: {sec: 0, nanosec: 0}, frame_id: ''}\n")
    file.write(f"joint_names: {json.dumps(trajectory.joints, ensure_ascii=False)}\n")
    file.write("points:\n")
    for nanoseconds, point in trajectory.points(rate):
        position, velocity, acceleration = map(_numbers, point)
        file.write(
            f"- {{positions: {position},\n   velocities: {velocity},\n"
            f"   accelerations: {acceleration},\n"
            f"   effort: [], time_from_start: {{sec: {nanoseconds // 10**9}, "
            f"nanosec: {nanoseconds % 10**9}}}}}\n"
        )


def motion_document(
    purpose: str,
    robot: str,
    trajectory: Trajectory,
    limits: MotionLimits,
    use: LimitUse,
    settings: Mapping[str, object],
    **figures: object,
) -> dict[str, object]:
    """Figures of a motion for JSON: what was asked for, limits and what is used of them.

    Limits in rad, rad/s, rad/s², N m and m; `figures`: what motions of this purpose have beyond.
    """
    allowed, used = ({k: _plain(v) for k, v in vars(part).items()} for part in (limits, use))
    return {
        "format": FORMAT,
        "purpose": purpose,
        "robot": robot,
        "joints": list(trajectory.joints),
        "settings": dict(settings),
        "duration": trajectory.duration,
        **figures,
        "limits": allowed,
        "use": used,
    }


def diagnosis_document(
    robot: str, limits: MotionLimits, diagnosis: Diagnosis, seed: int
) -> dict[str, object]:
    """Figures of a motion for diagnosis: segments and effects among them."""
    return motion_document(
        "diagnosis",
        robot,
        diagnosis.trajectory,
        limits,
        diagnosis.use,
        {"rate": diagnosis.trajectory.rate, "seed": seed},
        loop_bandwidth=diagnosis.bandwidth.tolist(),
        loop_bandwidth_known=diagnosis.bandwidth_configured,
        # s, rad/s (m/s), rad (m), Hz
        segments=[
            {name: _plain(getattr(segment, name)) for name in _OF_SEGMENTS}
            for segment in diagnosis.segments
        ],
        not_revealed=[
            {"effect": effect, "excitation_needed": needed}
            for effect, needed in NOT_REVEALED.items()
        ],
    )


def _plain(value: object) -> object:
    return value.tolist() if isinstance(value, np.ndarray) else value


def _files(out: FilePath) -> tuple[Path, ...]:
    """CSV, YAML and JSON, of ``run.csv`` and of ``run`` the same."""
    out, endings = as_file(out), (".csv", ".yaml", ".json")
    stem = out.stem if out.suffix in endings else out.name
    return tuple(out.with_name(f"{stem}{ending}") for ending in endings)


def _numbers(values: Iterable[float]) -> str:
    # A decimal point in every number: YAML would read 0 as an integer and 1e-05 as text.
    return "[" + ", ".join(f"{value + 0.0:.7f}" for value in values) + "]"
