"""Splice values into the bytes of a URDF: all else stays as it is, to the last blank."""

from collections.abc import Mapping
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

import numpy as np

from idim_iv_ros.errors import UsageError
from idim_iv_ros.simulator_files.links import LinkBody
from idim_iv_ros.simulator_files.named import Load
from idim_iv_ros.simulator_files.xml_edits import (
    Edits,
    Element,
    comment_text,
    end_of_tag,
    number_text,
    numbers,
    numbers_text,
)

MOMENTS = {
    "ixx": (0, 0),
    "ixy": (0, 1),
    "ixz": (0, 2),
    "iyy": (1, 1),
    "iyz": (1, 2),
    "izz": (2, 2),
}


def with_values(
    content: bytes,
    links: Mapping[str, LinkBody],
    dynamics: Mapping[str, Mapping[str, float]],
    mounted: Mapping[str, tuple[str, Load]],
    source: str,
) -> bytes:
    """Return the URDF with other inertials, damping and friction, and links for payloads.

    Parameters
    ----------
    content
        The bytes of the file.
    links
        Inertials of links by name; one is inserted where a link has none.
    dynamics
        ``damping`` and ``friction`` of joints by name.
    mounted
        Payloads by the name of their link, each with the link that carries it.
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
    edits = _UrdfEdits(content)
    for name, body in links.items():
        edits.inertial(found["link", name], body)
    for name, values in dynamics.items():
        edits.dynamics(found["joint", name], values)
    for name, (link, load) in mounted.items():
        edits.payload(found["robot", ""], name, link, load)
    return edits.made()


def _elements(content: bytes) -> dict[tuple[str, str], Element]:
    """Links and joints of the robot by tag and name."""
    parser = expat.ParserCreate()
    stack: list[Element] = []
    found: dict[tuple[str, str], Element] = {}

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = Element(parser.CurrentByteIndex, len(stack))
        element.end_of_start = end_of_tag(content, element.start)
        if not stack:
            found["robot", ""] = element
        elif len(stack) == 1 and tag in ("link", "joint"):
            found[tag, attributes.get("name", "")] = element
        elif stack:
            stack[-1].children.setdefault(tag, element)
        stack.append(element)

    def end(tag: str) -> None:
        stack.pop().end = parser.CurrentByteIndex

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.Parse(content, True)
    return found


def _moments(body: LinkBody) -> dict[str, str]:
    values = numbers_text(np.array([body.inertia[place] for place in MOMENTS.values()]))
    return dict(zip(MOMENTS, values.split(), strict=True))


def _inertial(body: LinkBody) -> list[str]:
    listed = " ".join(f'{key}="{value}"' for key, value in _moments(body).items())
    return [
        "<inertial>",
        f'  <origin xyz="{numbers_text(body.centre)}" rpy="0 0 0"/>',
        f'  <mass value="{number_text(body.mass)}"/>',
        f"  <inertia {listed}/>",
        "</inertial>",
    ]


class _UrdfEdits(Edits):
    """What the elements of a URDF hold."""

    def payload(self, robot: Element, name: str, carrier: str, load: Load) -> None:
        """A link of its own, fixed to another, at the end of the robot."""
        lines = [
            f"<!-- {comment_text(load.words)} -->",
            f"<link name={quoteattr(name)}>",
            *(f"  {line}" for line in _inertial(load.body)),
            "</link>",
            f'<joint name={quoteattr(f"{name}_fixed")} type="fixed">',
            f"  <parent link={quoteattr(carrier)}/>",
            f"  <child link={quoteattr(name)}/>",
            "</joint>",
        ]
        self.insert(robot.end, b"".join(b"  " + line.encode() + self.newline for line in lines))

    def inertial(self, link: Element, body: LinkBody) -> None:
        """Mass, centre and moments of a link."""
        centre = numbers_text(body.centre)
        inertial = link.children.get("inertial")
        if inertial is None:
            self.first_child(link, _inertial(body))
            return
        self.set(inertial.children["mass"], {"value": number_text(body.mass)})
        self.set(inertial.children["inertia"], _moments(body))
        origin = inertial.children.get("origin")
        if origin is None:
            before = inertial.children["mass"].start
            line = f'<origin xyz="{centre}" rpy="0 0 0"/>'
            self.insert(before, line.encode() + self.newline + self.indent(before))
        else:
            # The moments are written in the axes of the link: whoever turns them by an angle of
            # few digits gets the same.
            turned = numbers(self.attributes(origin).get("rpy", (0, 0))[:2], self.content)
            self.set(origin, {"xyz": centre} | ({"rpy": "0 0 0"} if any(turned) else {}))

    def dynamics(self, joint: Element, values: Mapping[str, float]) -> None:
        """Damping and friction of a joint."""
        texts = {key: number_text(value) for key, value in values.items()}
        element = joint.children.get("dynamics")
        if element is not None:
            self.set(element, texts)
            return
        listed = " ".join(f'{key}="{value}"' for key, value in texts.items())
        inside = max(joint.children.values(), key=lambda child: child.start)
        last = self.end_of(inside)
        line = self.newline + self.indent(inside.start) + f"<dynamics {listed}/>".encode()
        self.insert(last, line)
