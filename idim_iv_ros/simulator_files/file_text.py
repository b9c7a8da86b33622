"""Text of the files: from templates, and XML that a user wrote with other values.

Of the latter comments, order and line ends stay; blanks may not.
"""

import math
import re
from collections.abc import Iterator, Mapping
from typing import Any
from xml.dom import minidom
from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from xml.parsers.expat import ExpatError

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from idim_iv_ros.errors import UsageError
from idim_iv_ros.types import FloatArray

_TEMPLATES = Environment(
    loader=PackageLoader("idim_iv_ros.simulator_files"),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)
_DECLARATION = re.compile(rb"\s*<\?xml[^>]*\?>")


def file_text(template: str, **shown: object) -> str:
    """Return the text of a file from its template under ``templates/``."""
    return _TEMPLATES.get_template(f"{template}.j2").render(shown)


def read_xml(content: bytes, source: str) -> Any:
    """Return the document of a file, `source` in messages.

    Raises UsageError: no XML, UTF-16, or entities of its own.
    """
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise UsageError(f"{source}: is UTF-16; write it as UTF-8")
    if b"<!ENTITY" in content:
        raise UsageError(f"{source}: declares XML entities, which no robot model has")
    try:
        return minidom.parseString(content)
    except ExpatError as error:
        raise UsageError(f"{source}: not XML whose values can be changed: {error}") from error


def written_xml(document: Any, content: bytes) -> bytes:
    """Return the text of a document with the declaration, encoding and line ends of its file."""
    declaration = _DECLARATION.match(content.removeprefix(b"\xef\xbb\xbf"))
    parts = [] if declaration is None else [declaration[0].strip().decode()]
    parts += [node.toxml() for node in document.childNodes]
    text = "\n".join(parts) + ("\n" if content.endswith(b"\n") else "")
    if b"\r\n" in content:
        text = text.replace("\n", "\r\n")
    return text.encode(document.encoding or "utf-8", "xmlcharrefreplace")


def elements(parent: Any, *tags: str) -> Iterator[Any]:
    """Child elements, those with one of these names if any are given, in their order."""
    for node in parent.childNodes:
        if node.nodeType == node.ELEMENT_NODE and (not tags or node.tagName in tags):
            yield node


def set_values(node: Any, values: Mapping[str, str], *, zeros: bool = False) -> None:
    """Give attributes other values where they differ; add those that are missing.

    `zeros`: also those that are missing and zero.
    """
    for key, text in values.items():
        if node.hasAttribute(key):
            if not _same_numbers(node.getAttribute(key), text):
                node.setAttribute(key, text)
        elif zeros or any(float(word) for word in text.split()):
            node.setAttribute(key, text)


def set_child(parent: Any, tag: str, values: Mapping[str, str], *, first: bool) -> None:
    """Give the attributes of a child element other values; insert it where it is missing."""
    child = next(elements(parent, tag), None)
    if child is None:
        insert(parent, Element(tag, dict(values)), first=first)
    else:
        set_values(child, values)


def insert(parent: Any, *new: Element, first: bool) -> None:
    """Put elements and comments behind the start tag of an element, or before its end tag."""
    indent, ancestor = "\n", parent
    while ancestor.nodeType != ancestor.DOCUMENT_NODE:
        indent, ancestor = indent + "  ", ancestor.parentNode
    text = ""
    for node in new:
        ElementTree.indent(node)
        text += indent + ElementTree.tostring(node, encoding="unicode").replace("\n", indent)
    before = parent.firstChild if first else parent.lastChild
    if not first and before is not None and before.nodeType != before.TEXT_NODE:
        before = None
    if before is None:
        text += indent[:-2]
    parsed: Any = minidom.parseString(f"<new>{text}</new>").documentElement
    for node in list(parsed.childNodes):
        parent.insertBefore(parent.ownerDocument.importNode(node, True), before)


def _same_numbers(before: str, text: str) -> bool:
    """Whether two texts have the same numbers but for their rounding."""
    old, new = ([float(word) for word in numbers.split()] for numbers in (before, text))
    return len(new) == len(old) and np.allclose(new, old, rtol=1e-12, atol=0.0)


def number_text(value: float) -> str:
    """With more digits than any interval has a use for, and no rounding of sums."""
    return f"{float(value) + 0.0:.8g}"


def numbers_text(values: FloatArray) -> str:
    """Several of one kind, with the digits that the largest has."""
    largest = float(np.abs(values).max())
    digits = 7 - math.floor(math.log10(largest)) if largest > 0.0 else 0
    return " ".join(number_text(round(float(value), digits)) for value in values)


def element(tag: str, /, *children: Element, **attributes: str) -> Element:
    """Return a new element of XML with its content."""
    made = Element(tag, attributes)
    made.extend(children)
    return made


def comment(text: str) -> Any:
    """A text as an XML comment."""
    return ElementTree.Comment(f" {text.replace('--', '- -')} ")
