"""HTML that cannot be broken by a joint's name: text is escaped unless it is marked as HTML."""

from collections.abc import Iterable, Sequence
from html import escape

_EMPTY = frozenset({"input", "br", "col", "meta"})


class Html(str):
    """Text that is HTML already and is not escaped again."""

    __slots__ = ()


def tag(name: str, /, *children: object, **attributes: str | bool | None) -> Html:
    """Return an element; children that are not `Html` are escaped, None is left out.

    Parameters
    ----------
    name : str
        Name of the element.
    *children : object
        Text, `Html`, or iterables of them.
    **attributes : str, bool or None
        ``css`` stands for ``class`` and an underscore for a hyphen. None and False are left
        out, True is an attribute without a value.
    """
    written = "".join(
        f" {_attribute(key)}" if value is True else f' {_attribute(key)}="{escape(str(value))}"'
        for key, value in attributes.items()
        if value is not None and value is not False
    )
    if name in _EMPTY:
        return Html(f"<{name}{written}>")
    return Html(f"<{name}{written}>{join(*children)}</{name}>")


def join(*children: object) -> Html:
    """Return children one after the other, escaped where they are not `Html`."""
    return Html("".join(_text(child) for child in children))


def section(title: str, anchor: str, *children: object) -> Html:
    """Return a section of the report with its heading."""
    return tag("section", tag("h2", title), *children, id=anchor)


def bullets(sentences: Iterable[object]) -> Html:
    """Return an unordered list, or nothing if there is nothing to list."""
    items = [tag("li", sentence) for sentence in sentences]
    return tag("ul", items) if items else Html()


def key_numbers(numbers: Iterable[tuple[str, str, str]]) -> Html:
    """Return tiles, each with a name, a value and a note."""
    tiles = [
        tag("div", tag("dt", name), tag("dd", value), tag("dd", note, css="note"))
        for name, value, note in numbers
    ]
    return tag("dl", tiles, css="tiles")


def sentence(text: str, names: Sequence[str] = ()) -> str:
    """Return text as a sentence: a capital, unless it starts with one of `names`, and a stop."""
    if not any(text.startswith(name) for name in names):
        text = text[:1].upper() + text[1:]
    return text if text.endswith((".", "!", "?")) else f"{text}."


def _attribute(key: str) -> str:
    return "class" if key == "css" else key.rstrip("_").replace("_", "-")


def _text(child: object) -> str:
    if child is None:
        return ""
    if isinstance(child, Html):
        return child
    if isinstance(child, str):
        return escape(child)
    if isinstance(child, Iterable):
        return "".join(_text(each) for each in child)
    return escape(str(child))
