"""Files: their names, reading them, writing them whole or not at all, and which ones are ours.

A file that somebody else wrote, or changed since, is not replaced. This program's own are known so:

``.json`` by its key ``format``, ``.html`` by its generator, ``.mcap`` by the library that its head
names (a recorded bag is never replaced), ``.parquet`` by a key of its footer; ``.csv`` and
``.yaml`` by a digest, in the JSON file of the same name beside it (a motion) or in the first line
(a configuration): once edited, they are the user's.
"""

import hashlib
import json
import os
import stat
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, Final

from idim_iv_ros.encoding import SPELT, named
from idim_iv_ros.errors import UsageError
from idim_iv_ros.interruption import undone_if_interrupted, uninterrupted

FilePath = str | os.PathLike[str]
FilePaths = FilePath | Iterable[FilePath]

# The first part of every format, and how HTML and MCAP files name what wrote them.
PROGRAM = "idim_iv_ros"
IDENTIFICATION_FORMAT: Final = "idim_iv_ros/identification/1"  # of result.json
GAP_FORMAT: Final = "idim_iv_ros/gap/1"
ANY_GAP: Final = "idim_iv_ros/gap/"  # of any version: what is said of another is of its kind
CHECK_FORMAT: Final = "idim_iv_ros/check/1"
IMPORT_FORMAT = f"{PROGRAM}/import/1"
INIT_FORMAT = f"{PROGRAM}/init/1"
SIMULATION_FORMAT = f"{PROGRAM}/simulation/1"
REPLAY_FORMAT: Final = "idim_iv_ros/replay/1"
SERVO_FORMAT: Final = "idim_iv_ros/servo/1"
TRUTH_FORMAT = f"{PROGRAM}/truth/1"  # of BAG.truth.json

RESULT, GAP, REPORT = "result.json", "gap.json", "report.html"
REPLAY, EFFECTS = "replay.json", "effects.json"
SERVO = "servo.json"
FLEET, FLEET_PAGE = "fleet.json", "fleet.html"

GENERATOR = f'<meta name="generator" content="{PROGRAM}">'
NO_FILE = "a device, a pipe or a socket"
FILES = "files"  # key of a JSON file that holds the digests of the files beside it

_HEAD = 4096  # bytes in which the mark of this program is looked for
# The header of an MCAP file: opcode 1, its length, profile and library, each behind its length.
_MCAP = b"\x89MCAP0\r\n\1" + struct.pack("<QI4sI", 23, 4, b"ros2", len(PROGRAM)) + PROGRAM.encode()
_MARKS = {".html": GENERATOR.encode(), ".mcap": _MCAP}
_SIGNATURE = "# Written by idim_iv_ros. Digest of what follows, as long as nobody edits it: "


def as_paths(bags: FilePaths) -> tuple[Path, ...]:
    """Return one or many bags as paths; a UsageError says that there is none."""
    given = [bags] if isinstance(bags, (str, os.PathLike)) else list(bags)
    if not given:
        raise UsageError("no bag was given; at least one is needed")
    return tuple(Path(bag) for bag in given)


def as_file(out: FilePath) -> Path:
    """Return the path of a file to write; a UsageError where it is empty, ``.`` or ``/``."""
    path = Path(out)
    if not path.name:
        raise UsageError(f"--out {path}: the name of a file is needed")
    return path


def is_file(path: Path) -> bool:
    """Whether `path` is a file; see `is_there`."""
    return is_there(path) and path.is_file()


def is_there(path: Path) -> bool:
    """Whether there is a file or folder; a UsageError where its name is none, or not to be read."""
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    except (OSError, ValueError) as error:
        shown = str(path) if len(str(path)) < 80 else f"{str(path)[:60]}…"
        reason = getattr(error, "strerror", None) or error
        raise UsageError(f"{shown}: cannot be read: {reason}") from error
    return True


def read_text(
    path: Path,
    what: str,
    *,
    megabytes: float = 50.0,
    decode: Callable[[bytes], str] = lambda content: content.decode("utf-8-sig"),
) -> str:
    """Read a text file of at most so many `megabytes`; `what` is expected, for the message.

    `decode` makes text of bytes, or raises `ValueError` or `LookupError`. Raises UsageError:
    missing, unreadable, no regular file (a pipe may never end), too large, or no text.
    """
    try:
        state = path.stat()
        if stat.S_ISDIR(state.st_mode):
            raise IsADirectoryError(0, "it is a folder")
        if not stat.S_ISREG(state.st_mode):
            raise OSError(0, f"it is {NO_FILE}; write it to a file first")
        with path.open("rb") as file:
            content = file.read(int(1e6 * megabytes) + 1)
        if len(content) > 1e6 * megabytes:
            raise OSError(0, f"it is larger than {megabytes:g} MB")
        return decode(content)
    except (OSError, ValueError, LookupError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not a text file"
        raise UsageError(f"{path}: cannot read {what}: {reason or error}") from error


@contextmanager
def refused_if_unwritable(path: FilePath) -> Iterator[None]:
    """Turn an OSError within the ``with`` into a UsageError that names the file and the reason."""
    try:
        yield
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror or error}") from error


def probe_place(path: Path) -> None:
    """Write and remove a file beside `path`, before long work; an OSError says why it cannot be."""
    probe = _temporary(path)
    with uninterrupted():
        try:
            probe.write_bytes(b"\0")
        finally:
            probe.unlink(missing_ok=True)


def require_file_place(files: Iterable[Path], *, force: bool = False) -> None:
    """Refuse, before long work, files that cannot be written, or as `require_replaceable`."""
    files = list(files)
    require_replaceable(files, force=force)
    for file in files:
        if not file.parent.is_dir():
            raise UsageError(f"{file}: no folder {file.parent}")
        with refused_if_unwritable(file):
            probe_place(file)


def require_folder_place(folder: Path) -> None:
    """Refuse, before long work, a folder that cannot be written, or not be made."""
    place = folder.absolute()
    while not (is_there(place) or place.is_symlink()):
        place = place.parent
    try:
        probe_place(place / "probe")
    except OSError as error:
        reason = error.strerror or error
        raise UsageError(f"{folder}: cannot be written: {reason} ({place})") from error


@contextmanager
def made_folder(out: Path) -> Iterator[None]:
    """Make a folder and its parents; those that are empty after a failure are removed again."""
    missing = [folder for folder in (out, *out.parents) if not folder.exists()]

    def undo() -> None:
        with suppress(OSError):
            for folder in missing:
                folder.rmdir()

    try:
        with undone_if_interrupted(undo):
            out.mkdir(parents=True, exist_ok=True)
            yield
    except BaseException:
        undo()
        raise


@contextmanager
def complete_files(paths: Iterable[Path]) -> Iterator[dict[Path, Path]]:
    """Temporary files that take the names of `paths` together, if the ``with`` ends well.

    Raises OSError: a file cannot be written, or a folder has its name.
    """
    temporary = {path: _temporary(path) for path in paths}
    with ExitStack() as undone:
        for path, file in temporary.items():
            if path.is_dir():
                raise IsADirectoryError(f"{path} is a folder")
            undone.callback(file.unlink, missing_ok=True)
            undone.enter_context(undone_if_interrupted(partial(file.unlink, missing_ok=True)))
        yield temporary
        with uninterrupted():
            for path, file in temporary.items():
                file.replace(path)


def write_together(contents: Mapping[Path, str | bytes]) -> None:
    """Write files, texts in UTF-8, complete and together or not at all, as `complete_files`."""
    with complete_files(contents) as temporary:
        for path, content in contents.items():
            with temporary[path].open("wb") as file:
                raw = content if isinstance(content, bytes) else content.encode("utf-8", SPELT)
                file.write(raw)
                file.flush()
                os.fsync(file.fileno())


def _temporary(path: Path) -> Path:
    """Where a file is written before it is complete; a name of 255 bytes is a name, too."""
    name = hashlib.sha256(os.fsencode(path.name)).hexdigest()[:16]
    return path.with_name(f".{name}.{os.getpid()}.tmp")


def require_replaceable(paths: Iterable[Path], *, force: bool = False) -> None:
    """Refuse to replace what this program did not write (unless `force`), or what is no file."""
    for path in paths:
        try:
            kind = _kind(path)
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise UsageError(f"{path}: cannot be written: {reason}") from error
        if kind not in (None, "file"):
            raise UsageError(f"{path} is {kind}; give another --out")
        if kind and not force and not written_by_program(path):
            raise UsageError(
                f"{path}: exists, and was not written by idim_iv_ros or was changed since; give "
                "another --out, or --force to replace it"
            )


def _kind(path: Path) -> str | None:
    """``file`` or what else is there, in words; None where there is nothing."""
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return "a link that leads nowhere" if path.is_symlink() else None
    except NotADirectoryError:
        return None  # on the way there is a file; the missing folder is what is wrong
    if stat.S_ISDIR(mode):
        return "a folder"
    return "file" if stat.S_ISREG(mode) else NO_FILE


def written_by_program(path: Path) -> bool:
    """Whether this program wrote the file and nobody changed it in a way that can be seen."""
    suffix = path.suffix.lower()
    try:
        if suffix == ".json":
            return _marked_json(path) is not None
        if suffix == ".parquet":
            with path.open("rb") as file:  # metadata, its length, PAR1
                end = file.seek(0, os.SEEK_END) - 8
                file.seek(max(0, end))
                size, mark = struct.unpack("<I4s", file.read(8).rjust(8))
                file.seek(max(0, end - size))
                return mark == b"PAR1" and PROGRAM.encode() in file.read(size)
        if suffix not in _MARKS:
            return _marked_digest(path)
        with path.open("rb") as file:
            return _MARKS[suffix] in file.read(_HEAD)
    except (OSError, ValueError, RecursionError):
        return False


def digest(text: str) -> str:
    """SHA-256 of a text, in hexadecimal digits."""
    return hashlib.sha256(text.encode("utf-8")).hexdigest()


def digests(texts: Mapping[str, str]) -> dict[str, str]:
    """Digests of files by their names, for the key `FILES` of the JSON file beside them."""
    return {name: digest(text) for name, text in texts.items()}


def signed(text: str) -> str:
    """Text of a YAML file with a first line that says whether it was edited."""
    text = named(text)
    return f"{_SIGNATURE}{digest(text)}\n{text}"


def _marked_json(path: Path) -> dict[str, Any] | None:
    document = json.loads(path.read_text(encoding="utf-8"))
    stated = document.get("format") if isinstance(document, dict) else None
    return document if str(stated).startswith(f"{PROGRAM}/") else None


def _marked_digest(path: Path) -> bool:
    text = path.read_text(encoding="utf-8")
    first, _, rest = text.partition("\n")
    if first.startswith(_SIGNATURE):
        return first.removeprefix(_SIGNATURE) == digest(rest)
    stem = path.name.split(".", 1)[0]
    for place in {path.with_suffix(".json"), path.with_name(f"{stem}.json")}:
        files = ((_marked_json(place) if place.is_file() else None) or {}).get(FILES)
        if isinstance(files, dict) and files.get(path.name) == digest(text):
            return True
    return False
