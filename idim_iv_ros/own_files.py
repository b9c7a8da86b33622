"""Which files this program wrote as they are now, and may therefore replace.

======================  ==========================================================================
file                    known by
======================  ==========================================================================
``.json``               its key ``format``, which begins with ``idim_iv_ros/``
``.html``, ``.svg``     ``<meta name="generator" content="idim_iv_ros">``
``.png``                its text chunk ``Software``
``.mcap``               the library that its header names (a recorded bag is never replaced)
``.csv``, ``.yaml``     its digest in the JSON file of the same name beside it (a motion), or in
                        its own first line (a configuration): once edited, it is the user's
======================  ==========================================================================
"""

import hashlib
import json
import stat
import struct
from collections.abc import Iterable, Mapping
from pathlib import Path

from idim_iv_ros.errors import UsageError
from idim_iv_ros.formats import PROGRAM

GENERATOR = f'<meta name="generator" content="{PROGRAM}">'
PNG_SOFTWARE = b"Software\0" + PROGRAM.encode()  # content of the text chunk of a picture
FILES = "files"  # key of a JSON file that holds the digests of the files beside it

_HEAD = 4096  # characters of an HTML file in which the generator is looked for
_MCAP_MAGIC = b"\x89MCAP0\r\n"
_SIGNATURE = "# Written by idim_iv_ros. Digest of what follows, as long as nobody edits it: "


def require_replaceable(paths: Iterable[Path], *, force: bool = False) -> None:
    """Refuse to replace a file that this program did not write.

    Raises
    ------
    UsageError
        There is such a file (unless `force`), something else than a file in its place, or a name
        that cannot be.
    """
    for path in paths:
        try:
            kind = _kind(path)
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise UsageError(f"{path}: cannot be written: {reason}") from error
        if kind not in (None, "file"):
            raise UsageError(f"{path} is {kind}; give another --out")
        if kind and not force and not is_own(path):
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
    return "file" if stat.S_ISREG(mode) else "a device, a pipe or a socket"


def is_own(path: Path) -> bool:
    """Whether this program wrote the file and nobody changed it in a way that can be seen."""
    known = {
        ".json": _own_json,
        ".html": _own_html,
        ".svg": _own_html,
        ".png": _own_png,
        ".mcap": _own_mcap,
    }
    try:
        return known.get(path.suffix, _own_digest)(path)
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
    return f"{_SIGNATURE}{digest(text)}\n{text}"


def _own_json(path: Path) -> bool:
    document = json.loads(path.read_text(encoding="utf-8"))
    return isinstance(document, dict) and str(document.get("format")).startswith(f"{PROGRAM}/")


def _own_html(path: Path) -> bool:
    with path.open(encoding="utf-8") as file:
        return GENERATOR in file.read(_HEAD)


def _own_png(path: Path) -> bool:
    with path.open("rb") as file:
        return PNG_SOFTWARE in file.read(_HEAD)


def _own_mcap(path: Path) -> bool:
    """Whether its header (opcode 1: length, profile, library) names this program."""
    with path.open("rb") as file:
        start = file.read(_HEAD)
    if not start.startswith(_MCAP_MAGIC + b"\x01"):
        return False
    place = len(_MCAP_MAGIC) + 9
    try:
        (profile,) = struct.unpack_from("<I", start, place)
        (size,) = struct.unpack_from("<I", start, place + 4 + profile)
    except struct.error:
        return False
    library = start[place + 8 + profile :][:size]
    return library == PROGRAM.encode()


def _own_digest(path: Path) -> bool:
    text = path.read_text(encoding="utf-8")
    first, _, rest = text.partition("\n")
    if first.startswith(_SIGNATURE):
        return first.removeprefix(_SIGNATURE) == digest(rest)
    stem = path.name.split(".", 1)[0]
    for beside in {path.with_suffix(".json"), path.with_name(f"{stem}.json")}:
        if beside.is_file() and _own_json(beside):
            files = json.loads(beside.read_text(encoding="utf-8")).get(FILES)
            if isinstance(files, dict) and files.get(path.name) == digest(text):
                return True
    return False
