"""Configurations that differ in one section."""

from typing import Any

from idim_iv_ros.configuration import Configuration


def changed(configuration: Configuration, section: str, **values: Any) -> Configuration:
    """The configuration with other values in a section."""
    part = getattr(configuration, section).model_copy(update=values)
    return configuration.model_copy(update={section: part})
