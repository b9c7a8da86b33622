"""From a YAML file to plain values: text of any kind ends in a mapping or in one line."""

from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.events import AliasEvent, CollectionEndEvent, CollectionStartEvent, ScalarEvent

from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import read_text
from idim_iv_ros.validation import shortened

# A configuration has a few hundred lines and three levels.
_LARGEST_FILE = 0.1  # MB, for which the reader of YAML takes 1 to 2 s
_DEEPEST = 20


def read_mapping(path: Path) -> dict[Any, Any]:
    """Read a YAML file that holds one mapping; a UsageError says what is wrong with it."""
    text = read_text(path, "the configuration", megabytes=_LARGEST_FILE)
    try:
        _require_flat(path, text)
        data: Any = YAML(typ="safe", pure=True).load(text)
    except YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", None) or getattr(error, "reason", None) or "not YAML"
        raise UsageError(f"{path}{where}: {shortened(problem)}") from error
    except (ValueError, TypeError, OverflowError) as error:
        # Dates that are none, integers of thousands of digits, keys that cannot be compared.
        raise UsageError(f"{path}: not a configuration: {shortened(str(error))}") from error
    if not isinstance(data, dict):
        raise UsageError(f"{path}: a mapping of keys is needed, lines of KEY: VALUE")
    return data


def _require_flat(path: Path, text: str) -> None:
    """Refuse deep nesting, references within references, and characters that are no text."""
    anchored: list[bool] = []  # of each open collection, whether it or one around it is anchored
    for event in YAML(typ="safe", pure=True).parse(text):
        where = f"{path}, line {event.start_mark.line + 1}"
        if isinstance(event, ScalarEvent):
            try:
                event.value.encode()
            except UnicodeEncodeError as error:  # halves of characters, which an escape can spell
                words = f"{shortened(ascii(event.value))} is not text in UTF-8"
                raise UsageError(f"{where}: {words}") from error
        elif isinstance(event, CollectionStartEvent):
            anchored.append(event.anchor is not None or (bool(anchored) and anchored[-1]))
            if len(anchored) > _DEEPEST:
                raise UsageError(f"{where}: nested more than {_DEEPEST} deep: not a configuration")
        elif isinstance(event, CollectionEndEvent):
            anchored.pop()
        elif isinstance(event, AliasEvent) and anchored and anchored[-1]:
            raise UsageError(f"{where}: an alias within an anchor is not allowed")
