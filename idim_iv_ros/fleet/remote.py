"""Bags by path or URL: what is local is read where it lies, the rest through fsspec."""

import re
from collections.abc import Iterable
from pathlib import Path, PurePosixPath
from typing import Any

from idim_iv_ros.errors import UsageError, one_line
from idim_iv_ros.recording.bags.bag_file import ByteSource
from idim_iv_ros.recording.bags.folder import Bag, is_bag_file

# Classes of the clients of stores, by their names: which of them is installed nobody knows.
_CREDENTIALS = re.compile("Credential|Token|Profile|Authentication|SSO", re.IGNORECASE)
_NO_ANSWER = re.compile("Connect|Endpoint|Timeout|Proxy|SSL|Region", re.IGNORECASE)
_GIVEN = "for s3:// AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or AWS_PROFILE, give them"
INSTALL = 'a fleet needs Dask: pip install "idim-iv-ros[fleet]"'


class FetchedFile:
    """A file of an fsspec file system, see `ByteSource`; `fetched` counts the bytes read so far."""

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


class StoreError(OSError):
    """A store cannot be asked for any of its bags: nothing is wrong with them."""


def reachable(function: Any, *arguments: Any, **named: Any) -> Any:
    """Call a file system; whatever its own errors are, they are OSErrors here.

    Raises
    ------
    StoreError
        Nobody may ask, or nobody answers.
    OSError
        This file is not there, or may not be read.
    """
    try:
        return function(*arguments, **named)
    except FileNotFoundError as error:
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
    """Return the file system of a path or URL, and the path in it.

    Raises
    ------
    UsageError
        Nothing is installed that opens such a URL.
    """
    try:
        from fsspec import available_protocols
        from fsspec.core import url_to_fs
    except ImportError as error:
        raise UsageError(INSTALL) from error
    scheme = uri.partition("://")[0]
    try:
        system, path = url_to_fs(uri)
    except ImportError as error:
        words = f"{scheme}:// needs a package: {error}"
        raise UsageError(f"{uri}: cannot be opened: {words}") from error
    except Exception as error:
        words = one_line(error)
        if scheme != uri and scheme not in available_protocols():
            words = f"{scheme}:// is no kind of store; s3://, gs://, abfs:// and https:// are"
        raise UsageError(f"{uri}: cannot be opened: {words}") from error
    return system, str(path)


def require_stores(uris: Iterable[str]) -> None:
    """Refuse URLs of a kind that nothing here opens, before any bag is looked at.

    Raises
    ------
    UsageError
        There is one; the first is named.
    """
    for uri in {uri.partition("://")[0]: uri for uri in uris if not is_local(uri)}.values():
        file_system(uri)


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
        Path(PurePosixPath(part["name"]).name): FetchedFile(system, part["name"], part["size"])
        for part in files
    }
    return Bag(Path(PurePosixPath(path).name), sources)


def bag_parts(system: Any, path: str) -> list[dict[str, Any]]:
    """Files of a bag (name, size, and what else the store knows), in the order of their names."""
    information = reachable(system.info, path)
    if information["type"] != "directory":
        return [information]
    listed = reachable(system.ls, path, detail=True)
    files = [part for part in listed if is_bag_file(str(part["name"]))]
    if not files:
        raise FileNotFoundError(0, "no .mcap, .db3 or .bag file in this folder")
    return sorted(files, key=lambda part: (len(part["name"]), part["name"]))
