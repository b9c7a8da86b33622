"""Inputs that many tests make: configurations that differ in one section, documents with causes."""

from collections.abc import Mapping
from typing import Any

from idim_iv_ros.configuration import Configuration
from tests.report.sample_gap import sample_gap

Content = dict[str, Any]


def gap_content(*causes: Mapping[str, Any], parameters: Mapping[str, Any] | None = None) -> Content:
    """Return a whole document.

    Parameters
    ----------
    causes
        Keys that differ from those of a sample cause; `parameters` as name to value, or
        to a mapping with its std.
    parameters
        Base parameters of the extended model, name to value.
    """
    document = sample_gap(2, "structural").to_document()
    sample = document["causes"][0]
    made = [{**sample, **cause, "parameters": _numbers(cause["parameters"])} for cause in causes]
    return {**document, "causes": made, "extended_parameters": _numbers(parameters or {})}


def _numbers(values: Mapping[str, Any]) -> Content:
    return {
        name: value if isinstance(value, dict) else {"value": value, "std": None, "unit": ""}
        for name, value in values.items()
    }


changed = Configuration.changed
