"""Splice values into the bytes of an XML file: all else stays as it is, to the last blank."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from idim_iv_ros.types import FloatArray

_ATTRIBUTE = re.compile(rb"([^\s=/<>\"']+)\s*=\s*(\"[^\"]*\"|'[^']*')")


@dataclass
class Element:
    """Where an element is: its start tag, what holds the first of each child, its end."""

    start: int
    depth: int
    end_of_start: int = 0
    end: int = 0  # where its end tag begins; that of its start tag where it has none
    children: dict[str, "Element"] = field(default_factory=dict)


def end_of_tag(content: bytes, start: int) -> int:
    """Where the start tag ends, behind its ``>``."""
    quote, place = 0, start
    while True:
        byte = content[place]
        if quote:
            quote = 0 if byte == quote else quote
        elif byte in b"\"'":
            quote = byte
        elif byte == ord(">"):
            return place + 1
        place += 1


class Edits:
    """Replacements of spans of bytes, none over another."""

    def __init__(self, content: bytes):
        self.content = content
        self._edits: list[tuple[int, int, bytes]] = []
        self.newline = b"\r\n" if b"\r\n" in content else b"\n"

    def made(self) -> bytes:
        """Return the content with all edits."""
        content, end = [], len(self.content)
        for start, stop, text in sorted(self._edits, reverse=True):
            content += [self.content[stop:end], text]
            end = start
        return b"".join([self.content[:end], *reversed(content)])

    def set(self, element: Element, values: Mapping[str, str], *, zeros: bool = False) -> None:
        """Give attributes other values where they differ; add those that are missing.

        `zeros`: also those that are missing and zero.
        """
        present = self.attributes(element)
        for key, text in values.items():
            if key in present:
                start, stop = present[key]
                if not _same(numbers((start, stop), self.content), text):
                    self._edits.append((start, stop, text.encode()))
            elif zeros or any(float(word) for word in text.split()):
                place = element.end_of_start - 1
                if self.content[place - 1 : place] == b"/":
                    place -= 1
                while self.content[place - 1 : place].isspace():
                    place -= 1
                self.insert(place, f' {key}="{text}"'.encode())

    def rename(self, element: Element, old: str, new: str, text: str) -> None:
        """Put another attribute in the place of one."""
        for match in _ATTRIBUTE.finditer(self.content, element.start, element.end_of_start):
            if match[1] == old.encode():
                self._edits.append((match.start(), match.end(), f'{new}="{text}"'.encode()))

    def attributes(self, element: Element) -> dict[str, tuple[int, int]]:
        """Where the value of each attribute is, without its quotes."""
        tag = self.content[element.start : element.end_of_start]
        return {
            match[1].decode("ascii", "replace"): (
                element.start + match.start(2) + 1,
                element.start + match.end(2) - 1,
            )
            for match in _ATTRIBUTE.finditer(tag)
        }

    def first_child(self, element: Element, lines: list[str]) -> None:
        """Put lines behind the start tag, one step further in."""
        own = self.indent(element.start)
        inner = b"".join(self.newline + own + b"  " + line.encode() for line in lines)
        end = element.end_of_start
        if self.content[end - 2 : end] == b"/>":
            name = re.match(rb"<([^\s/>]+)", self.content[element.start :])
            assert name is not None
            closing = self.newline + own + b"</" + name[1] + b">"
            self._edits.append((end - 2, end, b">" + inner + closing))
        else:
            self.insert(end, inner)

    def end_of(self, element: Element) -> int:
        """Behind an element."""
        if self.content[element.end_of_start - 2 : element.end_of_start] == b"/>":
            return element.end_of_start
        return self.content.index(b">", element.end) + 1

    def indent(self, place: int) -> bytes:
        """Blanks before an element, where nothing else is on its line."""
        line = self.content.rfind(b"\n", 0, place) + 1
        before = self.content[line:place]
        return before if before.isspace() or not before else b"  "

    def replace(self, start: int, stop: int, text: bytes) -> None:
        """Put something in the place of a span."""
        self._edits.append((start, stop, text))

    def insert(self, place: int, text: bytes) -> None:
        """Put something between."""
        self._edits.append((place, place, text))


def numbers(span: tuple[int, int], content: bytes) -> list[float]:
    """Values between two places."""
    return [float(word) for word in content[span[0] : span[1]].split()]


def _same(before: list[float], text: str) -> bool:
    """Whether a text has the same numbers but for its rounding."""
    new = [float(word) for word in text.split()]
    return len(new) == len(before) and np.allclose(new, before, rtol=1e-12, atol=0.0)


def number_text(value: float) -> str:
    """With more digits than any interval has a use for, and no rounding of sums."""
    return f"{float(value) + 0.0:.8g}"


def numbers_text(values: FloatArray) -> str:
    """Several of one kind, with the digits that the largest has."""
    largest = float(np.abs(values).max())
    digits = 7 - math.floor(math.log10(largest)) if largest > 0.0 else 0
    return " ".join(number_text(round(float(value), digits)) for value in values)


def comment_text(text: str) -> str:
    """A text that an XML comment may hold."""
    return text.replace("--", "- -")
