"""How to obtain the same numbers again: command, versions, timing, configuration; and notes."""

import io
from pathlib import PurePath
from typing import Any

from ruamel.yaml import YAML

from idim_iv_ros.diagnosis.result import GapResult
from idim_iv_ros.encoding import shell_command
from idim_iv_ros.report.numerals import sentence, with_unit
from idim_iv_ros.report.section import Report, Section


def _context(report: Report[Any]) -> dict[str, Any]:
    result = report.result
    diagnosis = isinstance(result, GapResult)
    # Whoever reads the page elsewhere has the configuration from it, not its folder.
    name = PurePath(report.config).name
    if diagnosis:
        options = [word for effect in result.without for word in ("--without", effect)]
        words = ["diagnose", *result.bags, "--config", name, "--out", "why", *options]
    else:
        options = [] if result.estimator == "idim-iv" else ["--estimator", result.estimator]
        bags = [bag.path for bag in result.bags]
        words = ["identify", *bags, "--config", name, "--out", "results", *options]
    spent = {stage: with_unit(seconds, "s", 2) for stage, seconds in result.timing.items()}
    if spent:
        spent["all"] = with_unit(sum(result.timing.values()), "s", 2)
    return {
        "command": f"idim-iv {shell_command(*words)}",
        "config": name,
        "numbers": report.numbers,
        "cite": not diagnosis,
        "software": dict(result.software),
        "spent": spent,
        "configuration": _yaml(result.configuration),
        "extended": result.extended_parameters if diagnosis else {},
    }


def _yaml(configuration: dict[str, object]) -> str:
    """Return a configuration as it is written in the robot's file."""
    writer: Any = YAML(typ="safe", pure=True)
    writer.default_flow_style = None
    writer.sort_base_mapping_type_on_output = False
    writer.width = 100
    text = io.StringIO()
    writer.dump(configuration, text)
    return text.getvalue()


def _notes(report: Report[GapResult]) -> dict[str, Any] | None:
    result = report.result
    if not result.notes:
        return None
    names = [*result.joints, *result.bags]
    return {"notes": [sentence(note, names) for note in result.notes]}


PROVENANCE: Section[Any] = Section(
    "Repeat", "repeat", "provenance.html.j2", _context, "command, versions, configuration"
)
NOTES = Section(
    "Notes",
    "notes",
    "notes.html.j2",
    _notes,
    "how the recordings were read and what could not be done",
)
