"""How to repeat and cite the result: configuration, versions, timing."""

import io
from typing import Any

from ruamel.yaml import YAML

from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.report.markup import Html, section, tag
from idim_iv_ros.report.numerals import cell, with_unit

_PAPER = (
    "M. Brunot, A. Janot, F. Carrillo, H. Garnier, “A Pragmatic and Systematic Statistical "
    "Analysis for Identification of Industrial Robots”"
)


def provenance_section(result: IdentificationResult) -> Html:
    """Return everything that is needed to obtain the same numbers again."""
    bags = " ".join(quoted(bag.path) for bag in result.bags)
    estimator = "" if result.estimator == "idim-iv" else f" --estimator {result.estimator}"
    command = f"idim-iv identify {bags} --config robot.yaml --out results{estimator}"
    return section(
        "How to repeat and cite",
        "repeat",
        tag("p", "Save the configuration below as ", tag("code", "robot.yaml"), " and run"),
        tag("pre", command),
        tag("p", "All numbers, unrounded, are in ", tag("code", "result.json"), " beside this."),
        tag("p", f"The method: {_PAPER}. Name the version of the software below with it."),
        tag(
            "div",
            facts("Software", dict(result.software)),
            facts("Time spent", time_spent(result.timing)),
            css="grid pair",
        ),
        tag("h3", "Configuration"),
        tag("pre", yaml_text(result.configuration)),
    )


def facts(title: str, known: dict[str, str]) -> Html:
    """Return names and values as a table."""
    rows = [tag("tr", tag("th", name, scope="row"), cell(value)) for name, value in known.items()]
    return tag("table", tag("caption", title), tag("tbody", rows), css="facts")


def time_spent(timing: dict[str, float]) -> dict[str, str]:
    """Return the time of each stage and of all, in words."""
    spent = {stage: with_unit(seconds, "s", 2) for stage, seconds in timing.items()}
    if spent:
        spent["all"] = with_unit(sum(timing.values()), "s", 2)
    return spent


def yaml_text(configuration: dict[str, object]) -> str:
    """Return a configuration as it is written in the robot's file."""
    writer: Any = YAML(typ="safe", pure=True)
    writer.default_flow_style = None
    writer.sort_base_mapping_type_on_output = False
    writer.width = 100
    text = io.StringIO()
    writer.dump(configuration, text)
    return text.getvalue()


def quoted(path: str) -> str:
    """Return a path as a shell takes it."""
    safe = path and all(letter.isalnum() or letter in "/._-+" for letter in path)
    return path if safe else "'" + path.replace("'", "'\\''") + "'"
