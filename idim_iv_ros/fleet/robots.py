"""The configuration of each robot of a fleet: one file for all, or one for each robot or type."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from idim_iv_ros.configuration import Configuration, load_configuration
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.fleet.content import configuration_digest
from idim_iv_ros.fleet.result import BagResult
from idim_iv_ros.fleet.source import BagEntry
from idim_iv_ros.identification.prepare import configured_request
from idim_iv_ros.model import build_inverse_model, read_urdf_file


@dataclass(frozen=True)
class Robot:
    """A configuration with its robot description (URDF or MJCF; empty where the bags have it).

    That is all that a worker needs; `digest` is that of both.
    """

    configuration: Configuration
    description: bytes
    digest: str

    @classmethod
    def of(cls, configuration: Configuration) -> "Robot":
        """Read the robot description, and refuse what would be wrong for every bag."""
        configured_request(configuration)
        path = configuration.robot.description
        description = b"" if path is None else path.read_bytes()
        if path is not None:
            build_inverse_model(configuration, read_urdf_file(path), str(path))
        return cls(configuration, description, configuration_digest(configuration, description))

    def local(self) -> Configuration:
        """Return the configuration with a robot description on this machine."""
        path = self.configuration.robot.description
        if path is None or (path.is_file() and path.read_bytes() == self.description):
            return self.configuration
        if self.configuration.robot.mjcf is not None:
            raise DataError(
                f"{path}: an MJCF file reads others beside it, so that every worker needs the "
                "same folder; put it where all of them see it"
            )
        urdf = _kept(path.name, self.description)
        robot = self.configuration.robot.model_copy(update={"urdf": urdf})
        return self.configuration.model_copy(update={"robot": robot})


_folders: list[tempfile.TemporaryDirectory[str]] = []  # until the worker ends


@cache
def _kept(name: str, description: bytes) -> Path:
    folder = tempfile.TemporaryDirectory(prefix="idim_iv_")
    _folders.append(folder)
    path = Path(folder.name) / name
    path.write_bytes(description)
    return path


def robots_of(
    entries: Sequence[BagEntry], config: Path
) -> tuple[tuple[BagEntry, ...], dict[str, Robot]]:
    """Find the configuration of every robot by its name, and build its model once.

    `config` is a YAML file for all, or a folder with ``ROBOT.yaml`` or ``TYPE.yaml``, the first
    before the second. The entries get a type where none was given: the name of that file.

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
    loaded = {path: Robot.of(load_configuration(path)) for path in set(paths.values())}
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
