"""How to obtain the same numbers again, what was filtered and dropped, limits, notes and words."""

import io
from collections import Counter
from collections.abc import Sequence
from pathlib import Path, PurePath
from typing import Any

from ruamel.yaml import YAML

from idim_iv_ros.diagnosis.result import GapResult
from idim_iv_ros.encoding import shell_command
from idim_iv_ros.identification.result import BagSummary, IdentificationResult
from idim_iv_ros.report.gap_words import unit_in, untestable
from idim_iv_ros.report.numerals import count, exact, percent, sentence, with_unit
from idim_iv_ros.report.section import Report, Section


def _context(report: Report[Any]) -> dict[str, Any]:
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
        "configuration": configuration_text(result.configuration),
        "extended": result.extended_parameters if diagnosis else {},
    }


def configuration_text(configuration: dict[str, object]) -> str:
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


def _glossary(report: Report[Any]) -> dict[str, Any]:
    return {"diagnosis": isinstance(report.result, GapResult)}


GLOSSARY: Section[Any] = Section(
    "Glossary", "glossary", "glossary.html.j2", _glossary, "what the words of this page mean"
)


def _limits(report: Report[GapResult]) -> dict[str, Any]:
    return {"untestable": untestable(report.result)}


LIMITS = Section(
    "Limits",
    "limits",
    "limits.html.j2",
    _limits,
    "what this recording cannot show, and which motion would",
)


def _processing(report: Report[IdentificationResult]) -> dict[str, Any]:
    result = report.result
    used = result.processing
    speeds = zip(result.joints, used.minimum_speed, strict=False)
    return {
        "used": used,
        "decimation": _decimation(used.decimation_factors),
        "row_rate": exact(round(used.row_rate, 2), "rows"),
        "speeds": [
            (joint, with_unit(speed, unit_in(result, "rad/s", joint), 2)) for joint, speed in speeds
        ],
        "dropped": _dropped(result),
        "reasons": [sentence(reason, result.joints) for reason in used.reasons],
        "controller": [sentence(line, result.joints) for line in result.controller],
        "bags": [_recording(bag) for bag in result.bags],
    }


def _decimation(factors: Sequence[int]) -> str:
    kept = [f"1 of {factor}" if factor > 1 else "all" for factor in dict.fromkeys(factors)]
    return "none" if kept == ["all"] else " or ".join(kept)


def _dropped(result: IdentificationResult) -> list[tuple[str, str, str]]:
    """Samples that count, that were dropped by reason, and all: words, number, share."""
    dropped: Counter[str] = Counter()
    for bag in result.bags:
        dropped.update(bag.dropped)
    total = result.fit.samples + sum(dropped.values())
    lines = [("used", result.fit.samples)]
    lines += [(f"dropped: {reason}", samples) for reason, samples in dropped.items()]
    rows = [
        (words, count(samples), percent(100.0 * samples / total if total else None, 3))
        for words, samples in lines
    ]
    return [*rows, ("all", count(total), "")]


def _recording(bag: BagSummary) -> dict[str, Any]:
    notes = [
        f"{f'{note.topic}: ' if note.topic else ''}{note.what}"
        f"{f' ({count(note.count)}×)' if note.count > 1 else ''}"
        for note in bag.notes
    ]
    return {
        "bag": bag,
        "name": Path(bag.path).name,
        "size": f"{with_unit(bag.duration, 's', 4)} at {exact(bag.rate, 'Hz')}",
        "notes": [*notes, *(interval.sentence for interval in bag.frozen)],
        "clocks": [
            (
                clock.topic,
                "header stamps" if clock.source == "header" else "arrival time",
                count(clock.messages),
                with_unit(clock.rate, "Hz", 4),
                _seconds(clock.jitter),
                _seconds(clock.longest_gap),
                *map(count, (clock.gaps, clock.repeated, clock.backward)),
            )
            for clock in bag.clocks
        ],
    }


def _seconds(value: float) -> str:
    # Less than a nanosecond is rounding: ROS stamps hold no more.
    if value < 1e-9:
        return "0"
    if value < 1e-3:
        return with_unit(1e6 * value, "µs")
    return with_unit(1e3 * value, "ms") if value < 1.0 else with_unit(value, "s")


PROCESSING = Section(
    "Processing",
    "processing",
    "processing.html.j2",
    _processing,
    "filters, rates and clocks, and what was left out",
)
