"""The configuration of each robot of a fleet: one file for all, or one for each robot or type."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from idim_iv_ros.configuration import Configuration, load_configuration
from idim_iv_ros.errors import UsageError
from idim_iv_ros.fleet.bag_result import BagResult
from idim_iv_ros.fleet.source import BagEntry
from idim_iv_ros.fleet.task import Robot
from idim_iv_ros.identification.prepare import configured_request
from idim_iv_ros.model import build_inverse_model, read_urdf_file


def robots_of(
    entries: Sequence[BagEntry], config: Path
) -> tuple[tuple[BagEntry, ...], dict[str, Robot]]:
    """Find the configuration of every robot, and build its model once.

    Parameters
    ----------
    config
        A YAML file for all, or a folder with ``ROBOT.yaml`` or ``TYPE.yaml``, the first before the
        second.

    Returns
    -------
    entries : tuple of BagEntry
        With a type where none was given: the name of the file.
    robots : dict of robot to Robot

    Raises
    ------
    UsageError
        A robot without configuration, a wrong one, or a robot of two types.
    """
    paths: dict[str, Path] = {}
    types: dict[str, str] = {}
    for entry in entries:
        path = path_of(entry, config)
        kind = entry.type or path.stem
        if types.setdefault(entry.robot, kind) != kind:
            raise UsageError(
                f"{entry.uri}: robot {entry.robot} is of type {kind} here and of type "
                f"{types[entry.robot]} elsewhere; give each robot a name of its own"
            )
        paths[entry.robot] = path
    loaded = {path: Robot.of(_checked(load_configuration(path))) for path in set(paths.values())}
    typed = tuple(replace(entry, type=types[entry.robot]) for entry in entries)
    return typed, {robot: loaded[path] for robot, path in paths.items()}


def path_of(entry: BagEntry | BagResult, config: Path) -> Path:
    """Return the configuration of the robot of a bag, in a folder of them or the only one.

    Raises
    ------
    UsageError
        The folder has none.
    """
    if not config.is_dir():
        return config
    names = [name for name in (entry.robot, entry.type) if name]
    for name in names:
        if "/" not in name and (path := config / f"{name}.yaml").is_file():
            return path
    listed = " nor ".join(f"{name}.yaml" for name in names)
    raise UsageError(f"{config}: neither {listed} is there, for {entry.uri}")


def _checked(configuration: Configuration) -> Configuration:
    """Refuse, before any bag is read, what would be wrong for every bag."""
    configured_request(configuration)
    path = configuration.robot.description
    if path is not None:
        build_inverse_model(configuration, read_urdf_file(path), str(path))
    return configuration
