"""Robots of a fleet, and digests of bags, code and configurations, by which results are reused."""

import errno
import hashlib
import json
import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib import metadata
from pathlib import Path

from idim_iv_ros.configuration import Configuration, load_configuration
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.files import is_there
from idim_iv_ros.fleet.result import BagResult
from idim_iv_ros.fleet.source import (
    BagEntry,
    bag_parts,
    file_system,
    is_local,
    local_path,
    reachable,
)
from idim_iv_ros.identification.prepare import configured_request
from idim_iv_ros.model import build_inverse_model, read_urdf_file
from idim_iv_ros.recording.bags.folder import bag_files

_BLOCK = 1 << 20  # bytes
# What stores say of a content: a checksum first, else when it was written.
_MARKS = (
    *("ETag", "etag", "md5Hash", "content_md5", "crc32c", "sha256"),
    *("LastModified", "updated", "mtime", "last_modified", "created"),
)
# Folders whose code, like that of fleet/statistics, changes no result of a bag.
_WITHOUT = ("cli", "nodes", "report")


def content_of(uri: str) -> str:
    """Return the digest of the content of a bag: SHA-256 of local files.

    Of remote files it is that of size and checksum (else time of writing) in their store. Raises
    OSError, UsageError or DataError: it cannot be found or read.
    """
    digest = hashlib.sha256()
    if is_local(uri):
        path = local_path(uri)
        if not is_there(path):
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
        for local in bag_files(path):
            of_file = hashlib.sha256()
            with local.open("rb") as file:
                while block := file.read(_BLOCK):
                    of_file.update(block)
            digest.update(of_file.digest())
        return digest.hexdigest()
    system, name = file_system(uri)
    for part in bag_parts(system, name):
        # A listing may say less than the store knows of one object.
        details = reachable(system.info, part["name"])
        mark = next((f"{key} {details[key]}" for key in _MARKS if details.get(key)), "")
        digest.update(f"{details['size']} {mark}\n".encode())
    return digest.hexdigest()


def configuration_digest(configuration: Configuration, description: bytes) -> str:
    """Return the digest of a configuration and its robot description, wherever both lie."""
    values = configuration.changed("robot", urdf=None, mjcf=None).model_dump(mode="json")
    kind = "mjcf" if configuration.robot.mjcf is not None else "urdf"
    text = json.dumps([values, kind], sort_keys=True).encode()
    return hashlib.sha256(text + hashlib.sha256(description).digest()).hexdigest()


@cache
def code_version() -> str:
    """Return the version of the program with a digest of the code that makes results of bags."""
    package = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        place = path.relative_to(package)
        if place.parts[0] in _WITHOUT or place.parts[:2] == ("fleet", "statistics"):
            continue
        digest.update(str(place).encode() + b"\0" + path.read_bytes())
    return f"{metadata.version('idim-iv-ros')}+{digest.hexdigest()[:16]}"


def key_of(content: str, robot: "Robot", kind: str) -> str:
    """Return the key under which a result of this version of the code is kept."""
    words = (content, robot.digest, code_version(), kind)
    return hashlib.sha256("\n".join(words).encode()).hexdigest()


@dataclass(frozen=True)
class Robot:
    """A configuration, its URDF or MJCF (empty where bags have it), and the `digest` of both."""

    configuration: Configuration
    description: bytes
    digest: str

    @classmethod
    def of(cls, configuration: Configuration) -> "Robot":
        """Read the robot description, and check what would be wrong for every bag."""
        configured_request(configuration)
        path = configuration.robot.description
        description = b"" if path is None else path.read_bytes()
        if path is not None:
            build_inverse_model(configuration, read_urdf_file(path), str(path))
        return cls(configuration, description, configuration_digest(configuration, description))

    def local(self) -> Configuration:
        """Return the configuration with a file of the robot description on this machine."""
        path = self.configuration.robot.description
        if path is None or (path.is_file() and path.read_bytes() == self.description):
            return self.configuration
        if self.configuration.robot.mjcf is not None:
            raise DataError(
                f"{path}: an MJCF file reads others beside it, so that every worker needs the "
                "same folder; put it where all of them see it"
            )
        return self.configuration.changed("robot", urdf=_kept(path.name, self.description))


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
    """Find the configuration of each robot of the bags (see `path_of`); build its model once.

    Entries without a type get the name of that file as type. Raises UsageError: a robot without
    configuration, a wrong one, or a robot of two types.
    """
    paths: dict[str, Path] = {}
    types: dict[str, str] = {}
    for entry in entries:
        paths[entry.robot] = path = path_of(entry, config)
        kind = entry.type or path.stem
        if types.setdefault(entry.robot, kind) != kind:
            raise UsageError(
                f"{entry.uri}: robot {entry.robot} is of type {kind} here and of type "
                f"{types[entry.robot]} elsewhere; give each robot a name of its own"
            )
    loaded = {path: Robot.of(load_configuration(path)) for path in set(paths.values())}
    typed = tuple(replace(entry, type=types[entry.robot]) for entry in entries)
    return typed, {robot: loaded[path] for robot, path in paths.items()}


def path_of(bag: BagEntry | BagResult, config: Path) -> Path:
    """Return `config`, or in that folder ROBOT.yaml, else TYPE.yaml; a UsageError without any."""
    if not config.is_dir():
        return config
    names = [name for name in (bag.robot, bag.type) if name]
    for name in names:
        if "/" not in name and (path := config / f"{name}.yaml").is_file():
            return path
    listed = " nor ".join(f"{name}.yaml" for name in names)
    raise UsageError(f"{config}: neither {listed} is there, for {bag.uri}")
