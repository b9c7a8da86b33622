"""Message types of packages that rosbags does not know: their Python class and definition."""

import os
import sys
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from idim_iv_ros.errors import DataError
from idim_iv_ros.recording.writing.write import Definition


@cache
def python_type(message_type: str) -> type:
    """Return the class of a message type; a DataError says which package to install."""
    package, kind, name = message_type.split("/")
    try:
        return getattr(import_module(f"{package}.{kind}"), name)  # type: ignore[no-any-return]
    except (ImportError, AttributeError) as error:
        distribution = os.environ.get("ROS_DISTRO", "jazzy")
        apt = f"ros-{distribution}-{package.replace('_', '-')}"
        raise DataError(
            f"it is {message_type}, whose package {package} is not installed here (apt install "
            f"{apt}): not recorded; a bag by `ros2 bag record` is read without it"
        ) from error


def why_unreadable(message_type: str) -> str:
    """Return why messages of a type cannot be recorded; empty if they can."""
    try:
        python_type(message_type)
        definition(message_type)
    except DataError as error:
        return str(error)
    return ""


def has_header(message_type: str) -> bool:
    """Return whether messages of a type begin with a std_msgs/Header."""
    fields: dict[str, str] = python_type(message_type).get_fields_and_field_types()  # type: ignore[attr-defined]
    return next(iter(fields.values()), "") == "std_msgs/Header"


@cache
def definition(message_type: str) -> Definition | None:
    """Return the definition of a type from .msg files; None for one that rosbags knows.

    Raises DataError: the files are missing or cannot be read.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    if message_type in store.fielddefs:
        return None
    types: dict[str, Any] = {}
    waiting = [message_type]
    while waiting:
        name = waiting.pop()
        if name in types or name in store.fielddefs:
            continue
        types.update(_types_from_file(name))
        waiting += [part for _, described in types[name][1] for part in _type_names(described)]
    store.register(types)
    text, _ = store.generate_msgdef(message_type, ros_version=2)
    return Definition(text, store.hash_rihs01(message_type))


def _types_from_file(message_type: str) -> dict[str, Any]:
    package, kind, name = message_type.split("/")
    prefixes = [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]
    for prefix in filter(None, prefixes):
        path = Path(prefix) / "share" / package / kind / f"{name}.msg"
        try:
            return dict(get_types_from_msg(path.read_text(encoding="utf-8"), message_type))
        except FileNotFoundError:
            continue
        except Exception as error:  # a definition that rosbags cannot parse
            raise DataError(f"the definition of {message_type} in {path} cannot be read") from error
    raise DataError(
        f"it is {message_type}, whose definition is in none of the folders of AMENT_PREFIX_PATH: "
        "source the workspace that holds it; not recorded"
    )


def _type_names(described: tuple[Any, Any]) -> list[str]:
    node, detail = described
    if node == Nodetype.NAME:
        return [detail]
    return _type_names(detail[0]) if node in (Nodetype.ARRAY, Nodetype.SEQUENCE) else []
