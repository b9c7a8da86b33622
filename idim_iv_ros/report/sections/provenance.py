"""Sections on provenance: how to reproduce the numbers, what was filtered, limits, glossary."""

import io
from collections import Counter
from pathlib import Path, PurePath
from typing import Any

from ruamel.yaml import YAML

from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.encoding import shell_command
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.report.numerals import with_unit
from idim_iv_ros.report.section import Report


def repeat(report: Report[Any]) -> dict[str, Any]:
    """Return what the section on how to repeat the numbers shows."""
    result = report.result
    diagnosis = isinstance(result, GapResult)
    # Whoever reads the page elsewhere has the configuration from it, not its folder.
    name = PurePath(report.files.config).name
    if diagnosis:
        options = [word for effect in result.without for word in ("--without", effect)]
        words = ["diagnose", *result.bags, "--config", name, "--out", "why", *options]
    else:
        options = [] if result.estimator == "idim-iv" else ["--estimator", result.estimator]
        bags = [bag.path for bag in result.bags]
        words = ["identify", *bags, "--config", name, "--out", "results", *options]
    return {
        "command": f"idim-iv {shell_command(*words)}",
        "config": name,
        "numbers": report.numbers,
        "diagnosis": diagnosis,
        "configuration": configuration_text(result.configuration),
    }


def configuration_text(configuration: dict[str, object]) -> str:
    """Return a configuration as YAML, as in the robot's file."""
    writer: Any = YAML(typ="safe", pure=True)
    writer.default_flow_style = None
    writer.sort_base_mapping_type_on_output = False
    writer.width = 100
    text = io.StringIO()
    writer.dump(configuration, text)
    return text.getvalue()


def processing(report: Report[IdentificationResult]) -> dict[str, Any]:
    """Return what the section on filters, rates and clocks shows."""
    result = report.result
    dropped: Counter[str] = Counter()
    for bag in result.bags:
        dropped.update(bag.dropped)
    lines = {"used": result.fit.samples} | {f"dropped: {why}": n for why, n in dropped.items()}
    factors = dict.fromkeys(result.processing.decimation_factors)
    kept = [f"1 of {factor}" if factor > 1 else "all" for factor in factors]
    return {
        "used": result.processing,
        "decimation": "none" if kept == ["all"] else " or ".join(kept),
        "dropped": lines,
        "total": sum(lines.values()),
        "names": {bag.path: Path(bag.path).name for bag in result.bags},
        "seconds": _seconds,
    }


def _seconds(value: float) -> str:
    # Less than a nanosecond is rounding: ROS stamps hold no more.
    if value < 1e-9:
        return "0"
    if value < 1e-3:
        return with_unit(1e6 * value, "µs")
    return with_unit(1e3 * value, "ms") if value < 1.0 else with_unit(value, "s")
