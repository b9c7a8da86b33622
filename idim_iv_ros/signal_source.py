"""Where a signal is found: a topic, and which field of its messages where they hold several."""

from collections.abc import Mapping

_MARK = "#"  # no topic name may hold it

# In place of a topic: the robot records no efforts.
NO_EFFORT = "none"


def source_text(value: object) -> object:
    """Text ``topic#field`` of what a configuration file gives as a source.

    - `value`: a topic, ``topic#field``, or a mapping with the keys ``topic`` and ``field``;
      whatever else it is comes back as it is

    Raises ValueError: other keys, or a part is missing or empty.
    """
    if isinstance(value, Mapping):
        if not set(value) <= {"topic", "field"} or not isinstance(value.get("topic"), str):
            raise ValueError("a topic, or topic and field, is needed")
        field = value.get("field")
        if field is not None and not isinstance(field, str):
            raise ValueError("field must be a name")
        value = value["topic"] if field is None else f"{value['topic']}{_MARK}{field}"
    if isinstance(value, str) and _MARK in value:
        topic, _, field = value.partition(_MARK)
        if not topic or not field or _MARK in field:
            raise ValueError(f"{value!r} is no topic with a field: write topic{_MARK}field")
    return value


def topic_of(source: str) -> str:
    """Topic of ``topic`` or ``topic#field``."""
    return source.partition(_MARK)[0]


def field_of(source: str) -> str | None:
    """Field of ``topic#field``; None where none is named."""
    return source.partition(_MARK)[2] or None


def with_field(source: str, field: str) -> str:
    """Return the source with another field, ``topic#field``."""
    return f"{topic_of(source)}{_MARK}{field}"
