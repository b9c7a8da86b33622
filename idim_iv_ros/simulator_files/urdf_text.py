"""A user's URDF with other inertials, damping and friction, and links for payloads."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from idim_iv_ros.simulator_files.links import LinkBody
from idim_iv_ros.simulator_files.named import Load
from idim_iv_ros.simulator_files.xml_text import (
    comment_text,
    elements,
    number_text,
    numbers_text,
    put_before,
    put_first,
    put_last,
    read_xml,
    set_values,
    tag_text,
    written_xml,
)

_MOMENTS = {
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
    """Return the URDF with other values; all else stays, but for blanks.

    Inertials of `links` are by name, and one is inserted where a link has none; `dynamics` are
    ``damping`` and ``friction`` of joints by name; `mounted` are payloads by the name of their
    link, each with the link that carries it.

    Raises
    ------
    UsageError
        As `read_xml`, with `source` as the name of the URDF.
    """
    document = read_xml(content, source)
    robot = document.documentElement
    places = {
        (child.tagName, child.getAttribute("name")): child
        for child in elements(robot, "link", "joint")
    }
    for name, body in links.items():
        _set_inertial(places["link", name], body)
    for name, values in dynamics.items():
        _set_dynamics(places["joint", name], values)
    for name, (carrier, load) in mounted.items():
        fixed = tag_text("joint", {"name": f"{name}_fixed", "type": "fixed"})
        lines = [
            comment_text(load.words),
            tag_text("link", {"name": name}).replace("/>", ">"),
            *(f"  {line}" for line in _inertial(load.body)),
            "</link>",
            fixed.replace("/>", ">"),
            f"  {tag_text('parent', {'link': carrier})}",
            f"  {tag_text('child', {'link': name})}",
            "</joint>",
        ]
        put_last(robot, lines)
    return written_xml(document, content)


def _moments(body: LinkBody) -> dict[str, str]:
    values = numbers_text(np.array([body.inertia[place] for place in _MOMENTS.values()]))
    return dict(zip(_MOMENTS, values.split(), strict=True))


def _inertial(body: LinkBody) -> list[str]:
    return [
        "<inertial>",
        f"  {tag_text('origin', {'xyz': numbers_text(body.centre), 'rpy': '0 0 0'})}",
        f"  {tag_text('mass', {'value': number_text(body.mass)})}",
        f"  {tag_text('inertia', _moments(body))}",
        "</inertial>",
    ]


def _set_inertial(link: Any, body: LinkBody) -> None:
    """Mass, centre and moments of a link."""
    inertial = next(elements(link, "inertial"), None)
    if inertial is None:
        put_first(link, _inertial(body))
        return
    mass, inertia = (next(elements(inertial, tag)) for tag in ("mass", "inertia"))
    set_values(mass, {"value": number_text(body.mass)})
    set_values(inertia, _moments(body))
    centre = {"xyz": numbers_text(body.centre)}
    origin = next(elements(inertial, "origin"), None)
    if origin is None:
        put_before(mass, tag_text("origin", {**centre, "rpy": "0 0 0"}))
        return
    # The moments are written in the axes of the link: whoever turns them by an angle of few digits
    # gets the same.
    turned = any(float(angle) for angle in origin.getAttribute("rpy").split())
    set_values(origin, centre | ({"rpy": "0 0 0"} if turned else {}))


def _set_dynamics(joint: Any, values: Mapping[str, float]) -> None:
    """Damping and friction of a joint."""
    texts = {key: number_text(value) for key, value in values.items()}
    element = next(elements(joint, "dynamics"), None)
    if element is None:
        put_last(joint, [tag_text("dynamics", texts)])
    else:
        set_values(element, texts)
