"""Splice values into the bytes of a URDF: all else stays as it is, to the last blank."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from xml.parsers import expat

from idim_iv_ros.errors import UsageError
from idim_iv_ros.simulator_files.links import LinkBody
from idim_iv_ros.types import FloatArray

_ATTRIBUTE = re.compile(rb"([^\s=/<>\"']+)\s*=\s*(\"[^\"]*\"|'[^']*')")
MOMENTS = {
    "ixx": (0, 0),
    "ixy": (0, 1),
    "ixz": (0, 2),
    "iyy": (1, 1),
    "iyz": (1, 2),
    "izz": (2, 2),
}


@dataclass
class _Element:
    """Where an element is: its start tag, what holds the first of each child, its end."""

    start: int
    depth: int
    end_of_start: int = 0
    end: int = 0  # where its end tag begins; that of its start tag where it has none
    children: dict[str, "_Element"] = field(default_factory=dict)


def with_values(
    content: bytes,
    links: Mapping[str, LinkBody],
    dynamics: Mapping[str, Mapping[str, float]],
    source: str,
) -> bytes:
    """Return the URDF with other inertials, damping and friction.

    Parameters
    ----------
    content
        The bytes of the file.
    links
        Inertials of links by name; one is inserted where a link has none.
    dynamics
        ``damping`` and ``friction`` of joints by name.
    source
        What to call the URDF in messages.

    Raises
    ------
    UsageError
        The encoding of the file has no ASCII in it.
    """
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise UsageError(f"{source}: is UTF-16; write it as UTF-8")
    found = _elements(content)
    edits = _Edits(content)
    for name, body in links.items():
        edits.inertial(found["link", name], body)
    for name, values in dynamics.items():
        edits.dynamics(found["joint", name], values)
    return edits.made()


def _elements(content: bytes) -> dict[tuple[str, str], _Element]:
    """Links and joints of the robot by tag and name."""
    parser = expat.ParserCreate()
    stack: list[_Element] = []
    found: dict[tuple[str, str], _Element] = {}

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = _Element(parser.CurrentByteIndex, len(stack))
        element.end_of_start = _end_of_tag(content, element.start)
        if len(stack) == 1 and tag in ("link", "joint"):
            found[tag, attributes.get("name", "")] = element
        elif stack:
            stack[-1].children.setdefault(tag, element)
        stack.append(element)

    def end(tag: str) -> None:
        stack.pop().end = parser.CurrentByteIndex

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.Parse(content, True)
    return found


def _end_of_tag(content: bytes, start: int) -> int:
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


class _Edits:
    """Replacements of spans of bytes, none over another."""

    def __init__(self, content: bytes):
        self._content = content
        self._edits: list[tuple[int, int, bytes]] = []
        self._newline = b"\r\n" if b"\r\n" in content else b"\n"

    def inertial(self, link: _Element, body: LinkBody) -> None:
        """Mass, centre and moments of a link."""
        centre = _triple(body.centre)
        moments = {key: _text(body.inertia[place]) for key, place in MOMENTS.items()}
        inertial = link.children.get("inertial")
        if inertial is None:
            listed = " ".join(f'{key}="{value}"' for key, value in moments.items())
            self._first_child(
                link,
                [
                    "<inertial>",
                    f'  <origin xyz="{centre}" rpy="0 0 0"/>',
                    f'  <mass value="{_text(body.mass)}"/>',
                    f"  <inertia {listed}/>",
                    "</inertial>",
                ],
            )
            return
        self._set(inertial.children["mass"], {"value": _text(body.mass)})
        self._set(inertial.children["inertia"], moments)
        origin = inertial.children.get("origin")
        if origin is None:
            before = inertial.children["mass"].start
            line = f'<origin xyz="{centre}" rpy="0 0 0"/>'
            self._insert(before, line.encode() + self._newline + self._indent(before))
        else:
            # The moments are written in the axes of the link: whoever turns them by an angle of
            # few digits gets the same.
            turned = _numbers(self._attributes(origin).get("rpy", (0, 0))[:2], self._content)
            self._set(origin, {"xyz": centre} | ({"rpy": "0 0 0"} if any(turned) else {}))

    def dynamics(self, joint: _Element, values: Mapping[str, float]) -> None:
        """Damping and friction of a joint."""
        texts = {key: _text(value) for key, value in values.items()}
        element = joint.children.get("dynamics")
        if element is not None:
            self._set(element, texts)
            return
        listed = " ".join(f'{key}="{value}"' for key, value in texts.items())
        inside = max(joint.children.values(), key=lambda child: child.start)
        last = self._end_of(inside)
        line = self._newline + self._indent(inside.start) + f"<dynamics {listed}/>".encode()
        self._insert(last, line)

    def made(self) -> bytes:
        """Return the content with all edits."""
        content, end = [], len(self._content)
        for start, stop, text in sorted(self._edits, reverse=True):
            content += [self._content[stop:end], text]
            end = start
        return b"".join([self._content[:end], *reversed(content)])

    def _set(self, element: _Element, values: Mapping[str, str]) -> None:
        """Give attributes other values where they differ; add those that are missing."""
        present = self._attributes(element)
        for key, text in values.items():
            if key in present:
                start, stop = present[key]
                if _numbers((start, stop), self._content) != [float(word) for word in text.split()]:
                    self._edits.append((start, stop, text.encode()))
            elif any(float(word) for word in text.split()):
                place = element.end_of_start - 1
                if self._content[place - 1 : place] == b"/":
                    place -= 1
                while self._content[place - 1 : place].isspace():
                    place -= 1
                self._insert(place, f' {key}="{text}"'.encode())

    def _attributes(self, element: _Element) -> dict[str, tuple[int, int]]:
        """Where the value of each attribute is, without its quotes."""
        tag = self._content[element.start : element.end_of_start]
        return {
            match[1].decode("ascii", "replace"): (
                element.start + match.start(2) + 1,
                element.start + match.end(2) - 1,
            )
            for match in _ATTRIBUTE.finditer(tag)
        }

    def _first_child(self, element: _Element, lines: list[str]) -> None:
        """Put lines behind the start tag, one step further in."""
        own = self._indent(element.start)
        inner = b"".join(self._newline + own + b"  " + line.encode() for line in lines)
        end = element.end_of_start
        if self._content[end - 2 : end] == b"/>":
            name = re.match(rb"<([^\s/>]+)", self._content[element.start :])
            assert name is not None
            closing = self._newline + own + b"</" + name[1] + b">"
            self._edits.append((end - 2, end, b">" + inner + closing))
        else:
            self._insert(end, inner)

    def _end_of(self, element: _Element) -> int:
        """Behind an element."""
        if self._content[element.end_of_start - 2 : element.end_of_start] == b"/>":
            return element.end_of_start
        return self._content.index(b">", element.end) + 1

    def _indent(self, place: int) -> bytes:
        """Blanks before an element, where nothing else is on its line."""
        line = self._content.rfind(b"\n", 0, place) + 1
        before = self._content[line:place]
        return before if before.isspace() or not before else b"  "

    def _insert(self, place: int, text: bytes) -> None:
        self._edits.append((place, place, text))


def _numbers(span: tuple[int, int], content: bytes) -> list[float]:
    return [float(word) for word in content[span[0] : span[1]].split()]


def _text(value: float) -> str:
    """Shortest digits that are read back as the same number."""
    return repr(float(value) + 0.0)


def _triple(values: FloatArray) -> str:
    return " ".join(_text(value) for value in values)
