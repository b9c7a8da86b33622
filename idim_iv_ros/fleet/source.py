"""Which bags a fleet has, and whose they are: a manifest, a folder, or object storage."""

import csv
import io
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path, PurePosixPath
from typing import Any

from idim_iv_ros.errors import UsageError
from idim_iv_ros.fleet.remote import file_system, is_local, local_path, reachable
from idim_iv_ros.recording.bags.folder import is_bag_file

_COLUMNS = ("uri", "robot", "type", "time")
METADATA = "metadata.yaml"  # of a rosbag2 folder


@dataclass(frozen=True)
class BagEntry:
    """One bag of a fleet; see `BagResult` for its fields. `type` may be empty."""

    uri: str
    robot: str
    type: str = ""
    time: str | None = None
    labels: Mapping[str, str] = field(default_factory=dict)


def find_bags(source: str) -> tuple[BagEntry, ...]:
    """List the bags of a fleet, in the order of the manifest or of their paths.

    A source is a manifest (``.csv``, ``.parquet``) with the columns uri and robot, also type and
    time; any other column is a label. Or a folder, or a URL that fsspec opens, which is searched:
    ``ROBOT/BAG`` or ``TYPE/ROBOT/BAG``; bags that lie directly in it are of one robot.

    Raises
    ------
    UsageError
        Nothing is there, no bag is found, or the manifest is wrong.
    """
    system, path = file_system(source)
    try:
        if source.endswith((".csv", ".parquet")):
            content = reachable(system.cat_file, path)
            return _manifest(source, _rows(source, bytes(content)))
        folder, files = path, [path]
        if reachable(system.info, path)["type"] == "directory":
            files = [str(text) for text in reachable(system.find, path)]
        else:
            folder = str(PurePosixPath(path).parent)
    except FileNotFoundError as error:
        raise UsageError(f"{source}: no such file, folder or URL") from error
    except OSError as error:
        raise UsageError(f"{source}: cannot be read: {error.strerror or error}") from error
    entries = [
        _entry(bag, folder, bag if is_local(source) else system.unstrip_protocol(bag))
        for bag in _bags(files)
    ]
    if not entries:
        raise UsageError(f"{source}: no bag found (.mcap, .db3, .bag or a rosbag2 folder)")
    return tuple(entries)


def _bags(files: Iterable[str]) -> list[str]:
    """Bags among the files of a tree: rosbag2 folders, and files outside such folders."""
    paths = [PurePosixPath(text) for text in files]
    paths = [path for path in paths if not path.name.startswith(".")]
    folders = {path.parent for path in paths if path.name == METADATA}
    bags = {
        path.parent if path.parent in folders else path for path in paths if is_bag_file(path.name)
    }
    return sorted(map(str, bags))


def _entry(bag: str, folder: str, uri: str) -> BagEntry:
    """Take robot and type from the folders in which a bag lies."""
    parts = PurePosixPath(bag).relative_to(folder).parts
    robot = parts[-2] if len(parts) > 1 else PurePosixPath(folder).name
    return BagEntry(uri, robot, parts[-3] if len(parts) > 2 else "")


def _rows(source: str, content: bytes) -> list[dict[str, Any]]:
    """Return the rows of a manifest by the names of the columns."""
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
    """Check the rows of a manifest, and return its bags."""
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
        uri = _absolute(source, values["uri"])
        if uri in entries:
            raise UsageError(f"{where}: {values['uri']} is listed twice")
        labels = {name: str(text) for name, text in values.items() if name not in _COLUMNS}
        kind = str(values.get("type", ""))
        time = _time(where, values.get("time"))
        entries[uri] = BagEntry(uri, values["robot"], kind, time, labels)
    return tuple(entries.values())


def _absolute(source: str, uri: str) -> str:
    """Bags of a manifest lie where it lies, unless they say otherwise."""
    if "://" in uri or Path(uri).is_absolute():
        return uri
    if is_local(source):
        return str(local_path(source).absolute().parent / uri)
    return f"{source.rpartition('/')[0]}/{uri}"


def _time(where: str, value: object) -> str | None:
    if value is None:
        return None
    try:
        return iso_time(value if isinstance(value, datetime) else time_of(str(value)))
    except ValueError as error:
        words = f"time {value} is not in ISO 8601, as in 2026-03-01T12:00:00Z"
        raise UsageError(f"{where}: {words}") from error


def time_of(text: str) -> datetime:
    """Read ISO 8601, UTC where it names no zone; ValueError where it is none."""
    # Python 3.10 knows no Z.
    time = datetime.fromisoformat(text[:-1] + "+00:00" if text.endswith(("Z", "z")) else text)
    return time if time.tzinfo else time.replace(tzinfo=timezone.utc)


def iso_time(time: datetime) -> str:
    """``2026-03-01T12:00:00Z``; a time without zone is UTC."""
    time = time if time.tzinfo else time.replace(tzinfo=timezone.utc)
    text = time.astimezone(timezone.utc).isoformat(timespec="microseconds")
    return text.replace("+00:00", "Z").replace(".000000Z", "Z")
