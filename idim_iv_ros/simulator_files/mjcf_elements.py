"""Where the bodies of an MJCF are in its bytes."""

from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import read_text
from idim_iv_ros.simulator_files.xml_edits import Edits, Element, end_of_tag

# What puts other elements in its place, so that a body that moves is not one of this file's own.
_MADE_ELSEWHERE = {
    "attach": "takes bodies from another file: name that file as robot.mjcf",
    "replicate": "makes bodies: write them out",
    "composite": "makes bodies: write them out",
    "flexcomp": "makes bodies: write them out",
}
_JOINTS = ("joint", "freejoint")
_LARGEST = 50.0  # MB


@dataclass
class Body:
    """A `<body>`, its `<inertial>` and its joints, in the order of the file."""

    element: Element
    inertial: Element | None = None
    joints: list[Element] = field(default_factory=list)
    named_joints: list[str] = field(default_factory=list)


def with_included(
    content: bytes, path: Path, within: tuple[Path, ...] = ()
) -> tuple[bytes, tuple[str, ...]]:
    """Return an MJCF with the files that it includes in their place, and the names of these.

    As MuJoCo does: what is within the root of a file stands where that is included, and paths are
    relative to the folder of the file that is read first. `within`: files that include this one.

    Raises
    ------
    UsageError
        A file cannot be read or changed in place, or includes itself.
    """
    edits, names = Edits(content), tuple[str, ...]()
    for name, element in _walked(content, str(path)).included:
        file = (*within, path)[0].parent / name
        if file in (*within, path):
            raise UsageError(f"{path}: <include>: {name} includes itself")
        inner = read_text(file, "an included MJCF", megabytes=_LARGEST).encode()
        inner, more = with_included(inner, file, (*within, path))
        root = _walked(inner, str(file)).root
        edits.replace(
            element.start, edits.end_of(element), inner[root.end_of_start : root.end].strip()
        )
        names += (name, *more)
    return edits.made(), names


def elements_of(content: bytes, source: str) -> tuple[dict[str, Body], tuple[str, ...]]:
    """Return the bodies with a name, and what to say of files that it refers to.

    Raises
    ------
    UsageError
        UTF-16, entities, or elements that stand for others.
    """
    walker = _walked(content, source)
    notes: tuple[str, ...] = ()
    if walker.refers:
        notes = (
            f"the MJCF refers to other files ({walker.refers} and so on) as before, relative to "
            "its own folder: put it beside the file that it was made from, under another name, or "
            "copy these files to it",
        )
    return walker.bodies, notes


def _walked(content: bytes, source: str) -> "_Walker":
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise UsageError(f"{source}: is UTF-16; write it as UTF-8")
    if b"<!ENTITY" in content:
        raise UsageError(f"{source}: declares XML entities, which an MJCF does not have")
    walker = _Walker(content, source)
    try:
        walker.parser.Parse(content, True)
    except expat.ExpatError as error:
        raise UsageError(f"{source}: not XML that can be changed in place: {error}") from error
    return walker


class _Walker:
    def __init__(self, content: bytes, source: str):
        self.content, self.source = content, source
        self.bodies: dict[str, Body] = {}
        self.included: list[tuple[str, Element]] = []
        self.root = Element(0, 0)
        self.refers = ""
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler, self.parser.EndElementHandler = self._start, self._end
        self._stack: list[tuple[str, Element, Body | None]] = []

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        if tag in _MADE_ELSEWHERE:
            what = attributes.get("file") or attributes.get("model") or attributes.get("prefix")
            line = self.parser.CurrentLineNumber
            raise UsageError(
                f"{self.source}: line {line}: <{tag}>{f' ({what})' if what else ''} "
                f"{_MADE_ELSEWHERE[tag]}"
            )
        element = Element(self.parser.CurrentByteIndex, len(self._stack))
        element.end_of_start = end_of_tag(self.content, element.start)
        if not self._stack:
            self.root = element
        if tag == "include":
            self.included.append((attributes.get("file", ""), element))
        # A <frame> carries on for the body around it.
        body = self._stack[-1][2] if self._stack else None
        inside = any(each == "worldbody" for each, _, _ in self._stack)
        if inside and tag == "body":
            body = Body(element)
            self.bodies[attributes.get("name", "")] = body
        elif inside and body is not None and tag == "inertial":
            body.inertial = element
        elif inside and body is not None and tag in _JOINTS:
            body.joints.append(element)
            body.named_joints.append(attributes.get("name", ""))
        if attributes.get("file") and not self.refers:
            self.refers = attributes["file"]
        self._stack.append((tag, element, body))

    def _end(self, tag: str) -> None:
        _, element, _ = self._stack.pop()
        element.end = self.parser.CurrentByteIndex
