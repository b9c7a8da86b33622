r"""Text as any file and any stream takes it.

The name of a file is bytes. Those that are no text are halves of characters in Python (PEP 383),
which no encoding has: they are written as ``\xe9``. What else an encoding lacks is spelt:
``kg m2``, ``sigma``.
"""

import codecs
import json
import os
import shlex
import unicodedata
from collections.abc import Callable

SPELT = "idim_iv_ros.spelt"  # handler of errors for open() and streams
_SPELT_JSON = "idim_iv_ros.spelt_json"
_SPELLINGS = {
    **{"−": "-", "–": "-", "±": "+-", "≤": "<=", "≥": ">=", "≈": "~", "→": "->", "·": "*"},
    **{"×": "x", "½": "1/2", "√": "sqrt ", "°": " deg", "“": '"', "”": '"'},
}


def named(text: str) -> str:
    r"""Text without halves of characters: bytes that are no UTF-8 are spelt as ``\xe9``."""
    try:
        return text.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
    except UnicodeEncodeError:  # halves that stand for no byte
        return text.encode("ascii", "backslashreplace").decode("ascii")


def json_text(content: object, *, encoding: str = "utf-8", indent: int | None = 2) -> str:
    """Return JSON that can be written in `encoding`; ValueError if a number is not finite."""
    text = json.dumps(content, indent=indent, ensure_ascii=False, allow_nan=False) + "\n"
    return text.encode(encoding, _SPELT_JSON).decode(encoding)


def shell_command(*words: str) -> str:
    """Join words so that a shell takes them apart again, bytes that are no text too."""
    quoted = []
    for word in words:
        escaped = os.fsencode(word.replace("\\", "\\\\").replace("'", "\\'"))
        spelt = "$'" + escaped.decode("ascii", "backslashreplace") + "'"
        quoted.append(shlex.quote(word) if named(word) == word else spelt)
    return " ".join(quoted)


def _spelt(text: str) -> str:
    """Return characters in ASCII: σ as sigma, ² as 2, others by their number."""
    spelt = ""
    for character in text:
        name, plain = unicodedata.name(character, ""), unicodedata.normalize("NFKC", character)
        if name.startswith("GREEK"):
            plain = name.split()[-1].lower()
        plain = _SPELLINGS.get(character, plain)
        escaped = character.encode("ascii", "backslashreplace").decode()
        spelt += plain if plain.isascii() else escaped
    return spelt


def _register(name: str, spell: Callable[[str], str]) -> None:
    """Make `spell` the error handler `name` of encodings: it writes what they cannot."""

    def handle(error: UnicodeError) -> tuple[str | bytes, int]:
        if not isinstance(error, UnicodeEncodeError):
            raise error
        text = named(error.object[error.start : error.end])
        if error.encoding.replace("_", "-").lower().startswith("utf") and spell is _spelt:
            return text.encode(error.encoding), error.end
        return spell(text), error.end

    codecs.register_error(name, handle)


_register(SPELT, _spelt)
_register(_SPELT_JSON, lambda text: json.dumps(text)[1:-1])
