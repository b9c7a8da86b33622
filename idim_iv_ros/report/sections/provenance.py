"""Sections on provenance: how to reproduce the numbers, what was filtered, limits, glossary."""

import io
from collections import Counter
from pathlib import PurePath
from typing import Any

from ruamel.yaml import YAML

from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.encoding import shell_command
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.report.numerals import with_unit
from idim_iv_ros.report.section import Report


def repeat_command(report: Report[Any]) -> str:
    """Return the command that repeats the numbers of a page."""
    result = report.result
    # Whoever reads the page elsewhere has the configuration from it, not its folder.
    name = file_name(report.files.config)
    if isinstance(result, GapResult):
        options = [word for effect in result.without for word in ("--without", effect)]
        words = ["diagnose", *result.bags, "--config", name, "--out", "why", *options]
    else:
        options = [] if result.estimator == "idim-iv" else ["--estimator", result.estimator]
        bags = [bag.path for bag in result.bags]
        words = ["identify", *bags, "--config", name, "--out", "results", *options]
    return f"idim-iv {shell_command(*words)}"


def file_name(path: str) -> str:
    """Return the last part of a path."""
    return PurePath(path).name


def configuration_text(configuration: dict[str, object]) -> str:
    """Return a configuration as YAML, as in the robot's file."""
    writer: Any = YAML(typ="safe", pure=True)
    writer.default_flow_style = None
    writer.sort_base_mapping_type_on_output = False
    writer.width = 100
    text = io.StringIO()
    writer.dump(configuration, text)
    return text.getvalue()


def dropped_samples(result: IdentificationResult) -> dict[str, int]:
    """Return how many decimated samples were used, and dropped for which reason."""
    dropped: Counter[str] = Counter()
    for bag in result.bags:
        dropped.update(bag.dropped)
    return {"used": result.fit.samples} | {f"dropped: {why}": n for why, n in dropped.items()}


def decimation_words(result: IdentificationResult) -> str:
    """Return which samples the decimation keeps."""
    factors = dict.fromkeys(result.processing.decimation_factors)
    kept = [f"1 of {factor}" if factor > 1 else "all" for factor in factors]
    return "none" if kept == ["all"] else " or ".join(kept)


def seconds_words(value: float) -> str:
    """Return a short time in s, ms or µs."""
    # Less than a nanosecond is rounding: ROS stamps hold no more.
    if value < 1e-9:
        return "0"
    if value < 1e-3:
        return with_unit(1e6 * value, "µs")
    return with_unit(1e3 * value, "ms") if value < 1.0 else with_unit(value, "s")
