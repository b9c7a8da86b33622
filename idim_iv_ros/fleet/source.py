"""Bags and robots of a fleet: found, opened locally or by fsspec, and known by their digests."""

import csv
import errno
import hashlib
import io
import json
import os
import re
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from functools import cache
from importlib import metadata
from pathlib import Path, PurePosixPath
from typing import Any

from idim_iv_ros.configuration import Configuration, load_configuration
from idim_iv_ros.errors import DataError, UsageError, one_line
from idim_iv_ros.files import is_there
from idim_iv_ros.fleet.result import BagResult, iso_time, time_of
from idim_iv_ros.identification.prepare import configured_request
from idim_iv_ros.model import build_inverse_model, read_urdf_file
from idim_iv_ros.recording.bags.bag_file import ByteSource
from idim_iv_ros.recording.bags.folder import Bag, bag_files, is_bag_file

# Classes of the clients of stores, by their names: which of them is installed nobody knows.
_CREDENTIALS = re.compile("Credential|Token|Profile|Authentication|SSO", re.IGNORECASE)
_NO_ANSWER = re.compile("Connect|Endpoint|Timeout|Proxy|SSL|Region", re.IGNORECASE)
_GIVEN = "for s3:// AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or AWS_PROFILE, give them"
INSTALL = 'a fleet needs Dask: pip install "idim-iv-ros[fleet]"'


@dataclass
class FetchedFile:
    """A file of an fsspec file system as a `ByteSource`; `fetched` counts the bytes read."""

    system: Any
    path: str
    size: int
    fetched: int = 0

    def read(self, first: int, last: int) -> bytes:
        """Return the bytes `first` to `last`, the end excluded; OSError if unreachable."""
        content = reachable(self.system.cat_file, self.path, start=first, end=last)
        self.fetched += len(content)
        if len(content) != last - first:
            raise OSError(0, f"{self.path}: {len(content)} of {last - first} bytes were sent")
        return bytes(content)


class StoreError(OSError):
    """A store answers for none of its bags, so that no bag is at fault."""


def reachable(function: Any, *arguments: Any, **named: Any) -> Any:
    """Call a file system; its errors become OSErrors, or StoreError where the store is at fault."""
    try:
        return function(*arguments, **named)
    except FileNotFoundError as error:
        # Some stores say "not found" when the real cause is that they could not be asked.
        if isinstance(error.__cause__, OSError) and type(error.__cause__) is not type(error):
            raise StoreError(0, f"no answer ({one_line(error.__cause__)})") from error
        raise
    except OSError:
        raise
    except Exception as error:
        name = type(error).__name__
        if _CREDENTIALS.search(name):
            raise StoreError(0, f"no credentials ({one_line(error)}): {_GIVEN}") from error
        kind = StoreError if _NO_ANSWER.search(name) else OSError
        raise kind(0, one_line(error)) from error


def file_system(uri: str) -> tuple[Any, str]:
    """Return file system and path of a URL or path; a UsageError where no library opens it."""
    try:
        from fsspec import available_protocols
        from fsspec.core import url_to_fs
    except ImportError as error:
        raise UsageError(INSTALL) from error
    scheme = uri.partition("://")[0]
    try:
        return url_to_fs(uri)  # type: ignore[no-any-return]
    except Exception as error:
        words = one_line(error)
        if isinstance(error, ImportError):
            words = f"{scheme}:// needs a package: {error}"
        elif scheme != uri and scheme not in available_protocols():
            words = f"{scheme}:// is no kind of store; s3://, gs://, abfs:// and https:// are"
        raise UsageError(f"{uri}: cannot be opened: {words}") from error


def is_local(uri: str) -> bool:
    """Return whether a path or URL names a file of this machine."""
    return "://" not in uri or uri.startswith("file://")


def local_path(uri: str) -> Path:
    """Return the path of a local file given as a path or URL."""
    return Path(uri.removeprefix("file://"))


def open_bag(uri: str) -> Bag:
    """Return a bag at a path or URL, not read yet; an OSError says why it cannot be found."""
    if is_local(uri):
        return Bag(local_path(uri))
    system, path = file_system(uri)
    sources: dict[Path, ByteSource] = {
        Path(Path(part["name"]).name): FetchedFile(system, part["name"], part["size"])
        for part in bag_parts(system, path)
    }
    return Bag(Path(Path(path).name), sources)


def bag_parts(system: Any, path: str) -> list[dict[str, Any]]:
    """Return the files of a bag (name, size, details of the store), in the order of their names."""
    information = reachable(system.info, path)
    if information["type"] != "directory":
        return [information]
    listed = reachable(system.ls, path, detail=True)
    files = [part for part in listed if is_bag_file(str(part["name"]))]
    if not files:
        raise FileNotFoundError(0, "no .mcap or .db3 file in this folder")
    return sorted(files, key=lambda part: (len(part["name"]), part["name"]))


@dataclass(frozen=True)
class BagEntry:
    """One bag of a fleet; see `BagResult` for its fields. `type` may be empty."""

    uri: str
    robot: str
    type: str = ""
    time: str | None = None


def find_bags(source: str) -> tuple[BagEntry, ...]:
    """List the bags of a fleet, in the order of the manifest or of their paths.

    A source is a manifest (``.csv``, ``.parquet``) with the columns uri and robot, optionally type
    and time; or a folder or URL with ``ROBOT/BAG`` or ``TYPE/ROBOT/BAG``; bags directly in it are
    of one robot. Raises UsageError: no bag is found, or the manifest is wrong.
    """
    system, path = file_system(source)
    try:
        if source.endswith((".csv", ".parquet")):
            return _manifest(source, _rows(source, bytes(reachable(system.cat_file, path))))
        folder, files = path, [path]
        if reachable(system.info, path)["type"] == "directory":
            files = reachable(system.find, path)
        else:
            folder = str(PurePosixPath(path).parent)
    except FileNotFoundError as error:
        raise UsageError(f"{source}: no such file, folder or URL") from error
    except OSError as error:
        raise UsageError(f"{source}: cannot be read: {error.strerror or error}") from error
    entries = []
    for bag in _bags(files):
        parts = PurePosixPath(bag).relative_to(folder).parts
        robot = parts[-2] if len(parts) > 1 else PurePosixPath(folder).name
        uri = bag if is_local(source) else system.unstrip_protocol(bag)
        entries.append(BagEntry(uri, robot, parts[-3] if len(parts) > 2 else ""))
    if not entries:
        raise UsageError(f"{source}: no bag found (.mcap, .db3 or a rosbag2 folder)")
    return tuple(entries)


def _bags(files: Iterable[str]) -> list[str]:
    """Return the bags among the files of a tree: rosbag2 folders, and files outside them."""
    paths = [path for path in map(PurePosixPath, files) if not path.name.startswith(".")]
    folders = {path.parent for path in paths if path.name == "metadata.yaml"}
    bags = [path for path in paths if is_bag_file(path.name)]
    return sorted({str(path.parent if path.parent in folders else path) for path in bags})


def _rows(source: str, content: bytes) -> list[dict[str, Any]]:
    if source.endswith(".parquet"):
        import pyarrow
        from pyarrow import parquet

        try:
            return list(parquet.read_table(io.BytesIO(content)).to_pylist())
        except (pyarrow.ArrowException, OSError) as error:
            raise UsageError(f"{source}: not a Parquet file: {error}") from error
    try:
        return list(csv.DictReader(io.StringIO(content.decode("utf-8-sig")), strict=True))
    except (UnicodeDecodeError, csv.Error) as error:
        raise UsageError(f"{source}: not a table in UTF-8: {error}") from error


def _manifest(source: str, rows: list[dict[str, Any]]) -> tuple[BagEntry, ...]:
    if not rows:
        raise UsageError(f"{source}: the manifest names no bag")
    for column in ("uri", "robot"):
        if column not in rows[0]:
            listed = ", ".join(map(str, rows[0]))
            raise UsageError(f"{source}: no column {column}; it has {listed}")
    entries: dict[str, BagEntry] = {}
    for number, row in enumerate(rows, start=2 if source.endswith(".csv") else 1):
        where = f"{source}, row {number}"
        if None in row or (None in row.values() and source.endswith(".csv")):
            raise UsageError(f"{where}: its columns are not those of the first line")
        values = {name: value for name, value in row.items() if value not in (None, "")}
        for column in ("uri", "robot"):
            if not isinstance(values.get(column), str):
                raise UsageError(f"{where}: {column} is empty or no text")
        uri = values["uri"]
        if "://" not in uri and not Path(uri).is_absolute():  # beside the manifest
            folder = local_path(source).absolute().parent
            uri = str(folder / uri) if is_local(source) else f"{source.rpartition('/')[0]}/{uri}"
        if uri in entries:
            raise UsageError(f"{where}: {values['uri']} is listed twice")
        kind, time = str(values.get("type", "")), _time(where, values.get("time"))
        entries[uri] = BagEntry(uri, values["robot"], kind, time)
    return tuple(entries.values())


def _time(where: str, value: object) -> str | None:
    try:
        if value is None:
            return None
        return iso_time(value if isinstance(value, datetime) else time_of(str(value)))
    except ValueError as error:
        words = f"time {value} is not in ISO 8601, as in 2026-03-01T12:00:00Z"
        raise UsageError(f"{where}: {words}") from error


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
