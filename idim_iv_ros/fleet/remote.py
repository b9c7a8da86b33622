"""Bags by path or URL: what is local is read where it lies, the rest through fsspec."""

from pathlib import Path, PurePosixPath
from typing import Any

from idim_iv_ros.errors import UsageError, one_line
from idim_iv_ros.recording.bags.byte_source import ByteSource
from idim_iv_ros.recording.bags.folder import Bag, is_bag_file

INSTALL = 'a fleet needs Dask: pip install "idim-iv-ros[fleet]"'


class FetchedFile:
    """A file of an fsspec file system, see `ByteSource`.

    Attributes
    ----------
    size : int
    fetched : int
        Bytes that were read so far.
    """

    def __init__(self, system: Any, path: str, size: int):
        self.system, self.path, self.size = system, path, size
        self.fetched = 0

    def read(self, first: int, last: int) -> bytes:
        """Bytes `first` … `last`; OSError where they cannot be fetched."""
        content = reachable(self.system.cat_file, self.path, start=first, end=last)
        self.fetched += len(content)
        if len(content) != last - first:
            raise OSError(0, f"{self.path}: {len(content)} of {last - first} bytes were sent")
        return bytes(content)


def reachable(function: Any, *arguments: Any, **named: Any) -> Any:
    """Call a file system; whatever its own errors are, they are OSErrors here."""
    try:
        return function(*arguments, **named)
    except OSError:
        raise
    except Exception as error:
        raise OSError(0, one_line(error)) from error


def file_system(uri: str) -> tuple[Any, str]:
    """Return the file system of a path or URL, and the path in it.

    Raises
    ------
    UsageError
        Nothing is installed that opens such a URL.
    """
    try:
        from fsspec.core import url_to_fs
    except ImportError as error:
        raise UsageError(INSTALL) from error
    try:
        system, path = url_to_fs(uri)
    except Exception as error:
        raise UsageError(f"{uri}: cannot be opened: {one_line(error)}") from error
    return system, str(path)


def is_local(uri: str) -> bool:
    """Whether a path or URL names a file of this machine."""
    return "://" not in uri or uri.startswith("file://")


def local_path(uri: str) -> Path:
    """Return the path of what is local."""
    return Path(uri.removeprefix("file://"))


def open_bag(uri: str) -> Bag:
    """Return a bag, not read yet.

    Raises
    ------
    OSError
        It cannot be found, or its store does not answer.
    """
    if is_local(uri):
        return Bag(local_path(uri))
    system, path = file_system(uri)
    files = bag_parts(system, path)
    sources: dict[Path, ByteSource] = {
        Path(PurePosixPath(each["name"]).name): FetchedFile(system, each["name"], each["size"])
        for each in files
    }
    return Bag(Path(PurePosixPath(path).name), sources)


def bag_parts(system: Any, path: str) -> list[dict[str, Any]]:
    """Files of a bag (name, size, and what else the store knows), in the order of their names."""
    information = reachable(system.info, path)
    if information["type"] != "directory":
        return [information]
    listed = reachable(system.ls, path, detail=True)
    files = [each for each in listed if is_bag_file(str(each["name"]))]
    if not files:
        raise FileNotFoundError(0, "no .mcap, .db3 or .bag file in this folder")
    return sorted(files, key=lambda each: (len(each["name"]), each["name"]))
