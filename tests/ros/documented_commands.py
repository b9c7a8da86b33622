"""The `ros2` command lines of documentation and launch files, as the client takes them apart.

The client itself (ros2cli) is not on PyPI: this is what of its behaviour matters here.
"""

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from ruamel.yaml import YAML

FENCED = re.compile(r"^```\w*\n(.*?)^```$", flags=re.MULTILINE | re.DOTALL)
INLINE = re.compile(r"`(ros2 [^`]+)`")
ENDS = re.compile(r"[;|&]+")
FLAGS = {"--feedback", "-f", "--once"}


@dataclass(frozen=True)
class Command:
    """One command: where it stands, its verb (`topic echo`), its other words, its options."""

    where: str
    verb: str
    words: tuple[str, ...]
    options: dict[str, str]

    def __str__(self) -> str:
        return f"{self.where}: {' '.join(('ros2', self.verb, *self.words, *self.options))}"


def commands(where: str, text: str) -> Iterator[Command]:
    """Find the commands in lines for a shell."""
    for line in text.replace("\\\n", " ").splitlines():
        if "ros2 " not in line:
            continue
        reader = shlex.shlex(line, posix=True, punctuation_chars=";|&")
        reader.whitespace_split = True
        words = list(reader)
        while "ros2" in words:
            words = words[words.index("ros2") + 1 :]
            end = next((k for k, word in enumerate(words) if ENDS.fullmatch(word)), len(words))
            yield _command(where, words[:end])
            words = words[end:]


def commands_of_page(path: Path) -> Iterator[Command]:
    """Find the commands in the blocks and in the sentences of a page."""
    text = path.read_text(encoding="utf-8")
    for block in FENCED.findall(text):
        yield from commands(path.name, block)
    for span in INLINE.findall(FENCED.sub("", text)):
        yield from commands(path.name, " ".join(span.split()))


def _command(where: str, words: list[str]) -> Command:
    if words[0] in ("run", "launch"):
        return Command(where, words[0], tuple(words[1:]), {})
    plain: list[str] = []
    options: dict[str, str] = {}
    rest = iter(words[2:])
    for word in rest:
        if word.startswith("-"):
            options[word] = "" if word in FLAGS else next(rest)
        else:
            plain.append(word)
    return Command(where, " ".join(words[:2]), tuple(plain), options)


def interface(name: str) -> type:
    """Return the class of a type that is written `package/kind/Name`."""
    package, kind, type_name = name.split("/")
    return getattr(import_module(f"{package}.{kind}"), type_name)


def fill(message: object, text: str) -> None:
    """Set the fields that a command gives as YAML; raises where there is none of that name."""
    for name, value in (YAML(typ="safe").load(text) or {}).items():
        assert hasattr(message, name), f"{type(message).__name__} has no field {name}"
        setattr(message, name, value)  # the type is checked with ROS_PYTHON_CHECK_FIELDS
