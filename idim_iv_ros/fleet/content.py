"""Digests: of the content of a bag, and of everything else that a result depends on."""

import errno
import hashlib
import json
import os
from functools import cache
from importlib import metadata
from pathlib import Path

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.files import is_there
from idim_iv_ros.fleet.remote import bag_parts, file_system, is_local, local_path, reachable
from idim_iv_ros.recording.bags.folder import bag_files

_BLOCK = 1 << 20  # bytes
# What stores say of a content: a checksum first, else when it was written.
_CHECKSUMS = ("ETag", "etag", "md5Hash", "content_md5", "crc32c", "sha256")
_WRITTEN = ("LastModified", "updated", "mtime", "last_modified", "created")
# Folders whose code, like that of fleet/statistics, changes no result of a bag.
_WITHOUT = ("cli", "nodes", "report")


def content_of(uri: str) -> str:
    """Digest of the content of a bag: SHA-256 of local files.

    Of what is far away, size and checksum as its store keeps them (where it keeps none, the time
    when it was written): nothing is fetched.

    Raises
    ------
    OSError, UsageError, DataError
        It cannot be found or read.
    """
    digest = hashlib.sha256()
    if is_local(uri):
        path = local_path(uri)
        if not is_there(path):
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
        for file in bag_files(path):
            digest.update(_of_file(file))
        return digest.hexdigest()
    system, name = file_system(uri)
    for part in bag_parts(system, name):
        # A listing may say less than the store knows of one object.
        details = reachable(system.info, part["name"])
        marks = (key for key in (*_CHECKSUMS, *_WRITTEN) if details.get(key))
        mark = next((f"{key} {details[key]}" for key in marks), "")
        digest.update(f"{details['size']} {mark}\n".encode())
    return digest.hexdigest()


def _of_file(path: Path) -> bytes:
    """SHA-256 of a file, read block by block."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(_BLOCK):
            digest.update(block)
    return digest.digest()


def configuration_digest(configuration: Configuration, description: bytes) -> str:
    """Digest of a configuration and its robot description, wherever both lie."""
    robot = configuration.robot.model_copy(update={"urdf": None, "mjcf": None})
    values = configuration.model_copy(update={"robot": robot}).model_dump(mode="json")
    kind = "mjcf" if configuration.robot.mjcf is not None else "urdf"
    text = json.dumps([values, kind], sort_keys=True).encode()
    return hashlib.sha256(text + hashlib.sha256(description).digest()).hexdigest()


@cache
def code_version() -> str:
    """Version of the program, and a digest of its code as far as it makes results of bags."""
    package = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        place = path.relative_to(package)
        if place.parts[0] in _WITHOUT or place.parts[:2] == ("fleet", "statistics"):
            continue
        digest.update(str(place).encode() + b"\0" + path.read_bytes())
    return f"{metadata.version('idim-iv-ros')}+{digest.hexdigest()[:16]}"


def key_of(content: str, configuration: str, version: str, kind: str) -> str:
    """Name under which a result is kept."""
    return hashlib.sha256("\n".join((content, configuration, version, kind)).encode()).hexdigest()
