"""How to repeat and cite the result: configuration, versions, timing."""

import io
from typing import Any

from ruamel.yaml import YAML

from idim_iv_ros.report.json_result import plain
from idim_iv_ros.report.markup import Html, section, tag
from idim_iv_ros.report.numerals import cell, with_unit
from idim_iv_ros.result import IdentificationResult

_PAPER = (
    "M. Brunot, A. Janot, F. Carrillo, H. Garnier, “A Pragmatic and Systematic Statistical "
    "Analysis for Identification of Industrial Robots”"
)


def provenance_section(result: IdentificationResult) -> Html:
    """Return everything that is needed to obtain the same numbers again."""
    bags = " ".join(_quoted(bag.path) for bag in result.bags)
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
            _facts("Software", dict(result.software)),
            _facts("Time spent", _timing(result)),
            css="grid pair",
        ),
        tag("h3", "Configuration"),
        tag("pre", _yaml(result.configuration)),
    )


def _facts(title: str, facts: dict[str, str]) -> Html:
    rows = [tag("tr", tag("th", name, scope="row"), cell(value)) for name, value in facts.items()]
    return tag("table", tag("caption", title), tag("tbody", rows), css="facts")


def _timing(result: IdentificationResult) -> dict[str, str]:
    spent = {stage: with_unit(seconds, "s", 2) for stage, seconds in result.timing.items()}
    if spent:
        spent["all"] = with_unit(sum(result.timing.values()), "s", 2)
    return spent


def _yaml(configuration: dict[str, object]) -> str:
    writer: Any = YAML(typ="safe", pure=True)
    writer.default_flow_style = None
    writer.sort_base_mapping_type_on_output = False
    writer.width = 100
    text = io.StringIO()
    writer.dump(plain(configuration), text)
    return text.getvalue()


def _quoted(path: str) -> str:
    safe = path and all(letter.isalnum() or letter in "/._-+" for letter in path)
    return path if safe else "'" + path.replace("'", "'\\''") + "'"
