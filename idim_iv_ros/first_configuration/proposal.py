"""From bags and a URDF to a first configuration, a YAML file in which every key has its line."""

import io
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError
from pydantic.fields import FieldInfo
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap

from idim_iv_ros.compilation import one_thread
from idim_iv_ros.configuration import Configuration, Section
from idim_iv_ros.configuration_file import read_mapping
from idim_iv_ros.encoding import named
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import (
    FilePath,
    FilePaths,
    as_paths,
    refused_if_unwritable,
    require_replaceable,
    signed,
    write_together,
)
from idim_iv_ros.first_configuration.signals import guess_effort_unit, propose_law
from idim_iv_ros.first_configuration.topics import (
    BagContents,
    choose_joints,
    choose_states,
    choose_topics,
    read_contents,
)
from idim_iv_ros.identification.prepare import prepare, read_configured
from idim_iv_ros.identification.sanity import joint_findings
from idim_iv_ros.model import read_urdf_file
from idim_iv_ros.model.urdf import description_key
from idim_iv_ros.progress import Progress, Stopwatch
from idim_iv_ros.signal_source import NO_EFFORT, field_of, topic_of, with_field
from idim_iv_ros.validation import first_problem

SOURCES = ("joint_states", "effort", "reference", "link_states")


@dataclass(frozen=True)
class DriverPreset:
    """Keys that the drivers of one kind of robot have in common."""

    name: str
    # By section, as a configuration has them; sources of signals as text
    keys: Mapping[str, Mapping[str, Any]]

    def sources(self, bags: Sequence[BagContents]) -> tuple[dict[str, str], dict[str, str]]:
        """Sources of signals that every bag holds, and why the others are left out.

        A robot in a namespace has the same topics below it: ``/left/joint_states``.
        """
        sources, reasons = {}, {}
        # Of topics that every bag has.
        listed = [{*bag.unreadable, *(topic.name for topic in bag.topics)} for bag in bags]
        names = set.intersection(*listed)
        for key in SOURCES:
            source = self.keys.get("signals", {}).get(key)
            if source is None:
                continue
            wanted, field = topic_of(source), field_of(source)
            topics = [wanted] if wanted in names else [n for n in names if n.endswith(wanted)]
            if len(topics) == 1:
                sources[key] = topics[0] if field is None else with_field(topics[0], field)
            else:
                reasons[key] = f"{wanted} of the driver {self.name} is not in the bag"
        return sources, reasons


def driver_files() -> dict[str, Path]:
    """Files of the drivers that come with this program, by name."""
    for parent in Path(__file__).resolve().parents:
        # Installed by pip or colcon; in a checkout.
        folders = (parent / "share" / "idim_iv_ros" / "config", parent / "config")
        paths = [sorted((folder / "drivers").glob("*.yaml")) for folder in folders]
        if any(paths):
            return {path.stem: path for path in chain(*paths)}
    return {}


def read_driver(name: str) -> DriverPreset:
    """Read the file of a driver by its name, or one of the user by its path.

    Raises UsageError: there is none, or it holds what no configuration has.
    """
    shipped = driver_files()
    path = shipped.get(name, Path(name))
    if name not in shipped and not name.endswith((".yaml", ".yml")):
        listed = ", ".join(shipped) or "none is installed"
        raise UsageError(f"no driver {name}: known are {listed}; or give a YAML file")
    data = read_mapping(path)
    if "robot" in data:
        raise UsageError(f"{path}: a driver says nothing of the robot: leave the key robot out")
    try:
        # The robot is another one each time: one joint, so that no list can have a wrong length.
        whole = Configuration.model_validate({"robot": {"joints": ["joint"]}, **data})
    except ValidationError as error:
        raise UsageError(f"{path}: {first_problem(error)}") from error
    given = whole.model_dump(exclude_unset=True)
    return DriverPreset(path.stem, {k: v for k, v in given.items() if k != "robot"})


_WIDTH = 10_000  # no value is broken over lines
# Sections of a configuration; what only `idim-iv simulate` reads comes last.
SECTIONS: dict[str, type[Section]] = {
    name: field.annotation
    for name, field in sorted(
        Configuration.model_fields.items(), key=lambda item: item[0] == "simulated_robot"
    )
    if isinstance(field.annotation, type) and issubclass(field.annotation, Section)
}


@dataclass(frozen=True)
class Proposal:
    """A first configuration of a robot, with the reasons for its values."""

    bags: tuple[Path, ...]
    joints: tuple[str, ...]  # Those that are identified
    urdf: Path | None  # None where the bag has /robot_description
    # Keys by section, the URDF left out: its path depends on where the file is written
    values: Mapping[str, Mapping[str, object]]
    reasons: Mapping[tuple[str, str], str]  # Why a key of a section has its value, or has none
    left_out: Mapping[str, str]  # Joints that are not identified, and why
    # Effort limits of the URDF, N m (N), for `controller.torque_limit`; empty where it has
    # none
    limits: tuple[float, ...]
    warnings: tuple[str, ...]

    def values_for(self, out: Path) -> dict[str, dict[str, object]]:
        """Keys by section for a file at `out`, with the path of the URDF relative to it."""
        values = {section: dict(keys) for section, keys in self.values.items()}
        if self.urdf is not None:
            path = os.path.relpath(self.urdf.resolve(), out.resolve().parent)
            if named(path) != path:
                raise UsageError(f"{path}: rename it: a configuration is text in UTF-8")
            key = description_key(self.urdf)
            values["robot"] = {key: Path(path).as_posix(), **values["robot"]}
        return values


def propose_configuration(
    bags: FilePaths,
    urdf: FilePath | None = None,
    *,
    driver: str | None = None,
    progress: Progress | None = None,
) -> Proposal:
    """Look through bags and propose a configuration with which they can be identified.

    - `bags`: one recording or several of one robot
    - `urdf`: its description; None: /robot_description of the bag
    - `driver`: name of one whose topics and units are known (``ur``), or a YAML file of that form
    - `progress`: called with a stage in words and the share that is done, 0 to 1

    Raises UsageError: no such file, no URDF, or one that cannot be used; DataError: the bags hold
    nothing that can be identified.
    """
    paths = as_paths(bags)
    preset = None if driver is None else read_driver(driver)
    with one_thread(), Stopwatch(progress) as watch:
        watch.stage("looking through the bag", 0.0)
        contents = [read_contents(path) for path in paths]
        text, source = _description(contents, None if urdf is None else Path(urdf))
        named, missing = preset.sources(contents) if preset is not None else ({}, {})
        states, effort = choose_states(contents, topic_of(named.get("joint_states", "")))
        servo = effort is None and not states.with_effort()
        where = topic_of(named.get("effort", "")) or (effort or states).name
        efforts = None if servo else where
        joints, left_out, warnings = choose_joints(text, source, contents, states.name, efforts)
        topics, why = choose_topics(contents, joints, states, effort)
        sources = {**topics, **named}  # those of the driver where it names them
        reasons = {("signals", key): reason for key, reason in why.items()}
        values: dict[str, dict[str, object]] = {"robot": {"joints": joints}}
        values["signals"] = dict(sources)
        limits: tuple[float, ...] = ()
        if servo:
            values["signals"]["effort"] = NO_EFFORT
            reasons["signals", "effort"] = "no bag has any: `idim-iv servo` identifies the servos"
        else:
            watch.stage("reading", 0.3)
            robot = {} if urdf is None else {description_key(Path(urdf)): Path(urdf)}
            given = {"robot": {**robot, **values["robot"]}, "signals": sources}
            configuration = Configuration.model_validate(given)
            recordings = read_configured(paths, configuration)
            watch.stage("model and filters", 0.4)
            prepared = prepare(recordings, configuration)
            watch.stage("effort unit", 0.6)
            unit, why_unit = guess_effort_unit(prepared)
            watch.stage("control law", 0.8)
            values["controller"], reasons["controller", "type"] = propose_law(prepared.motions)
            values["signals"]["effort_unit"], reasons["signals", "effort_unit"] = unit, why_unit
            findings = joint_findings(prepared.model, prepared.motions, prepared.cutoffs, unit)
            warnings += tuple(f"{joints[f.joint]}: {f.sentence}" for f in findings)
            most = prepared.model.robot.limits.effort
            if (most > 0.0).all() and np.isfinite(most).all():
                limits = tuple(most.tolist())
            if preset is not None:
                _merge(preset, values, reasons, named, missing)
                stated = values["signals"]["effort_unit"]
                reasons["signals", "effort_unit"] += f"; of the bag: {why_unit}"
                if stated != unit and not why_unit.startswith("not"):
                    warnings += (
                        f"efforts of the driver {preset.name} are in {stated}, but those of the "
                        f"bag look like {unit}: {why_unit}",
                    )
            if values["signals"]["effort_unit"] != "N m":
                warnings, limits = (*warnings, _UNIT_WARNING), ()
    return Proposal(
        bags=paths,
        joints=tuple(joints),
        urdf=None if urdf is None else Path(urdf),
        values=values,
        reasons=reasons,
        left_out=left_out,
        limits=limits,
        warnings=warnings,
    )


def _merge(
    preset: DriverPreset,
    values: dict[str, dict[str, object]],
    reasons: dict[tuple[str, str], str],
    named: Mapping[str, str],
    missing: Mapping[str, str],
) -> None:
    """Put the keys of a driver over those of the bag, with their reasons."""
    for section, keys in preset.keys.items():
        for key, value in keys.items():
            if (section, key) not in {("signals", source) for source in SOURCES}:
                values.setdefault(section, {})[key] = value
                reasons[section, key] = f"driver {preset.name}"
    for key in named:
        before = "" if key == "reference" else reasons.get(("signals", key), "")
        reasons["signals", key] = "; ".join(filter(None, (f"driver {preset.name}", before)))
    for key, reason in missing.items():
        before = reasons.get(("signals", key), "")
        reasons["signals", key] = "; ".join(filter(None, (before, reason)))


_UNIT_WARNING = (
    "the efforts are no torques: joints whose torque constants differ do not fit one model, "
    "and nothing can be compared with the URDF; give torque constant times gear ratio of each "
    "joint as signals.effort_scale, and effort_unit N m"
)


def _description(contents: list[BagContents], urdf: Path | None) -> tuple[str, str]:
    """Text of the robot's URDF, and its name for messages."""
    if urdf is not None:
        return read_urdf_file(urdf), str(urdf)
    for bag in contents:
        if bag.description is not None:
            return bag.description, f"{bag.path.name} /robot_description"
    raise UsageError(
        f"{contents[0].path}: no /robot_description in the bag: give the robot's URDF with --urdf"
    )


def configuration_text(proposal: Proposal, out: FilePath) -> str:
    """Return the text of a configuration file at `out`."""
    values = proposal.values_for(Path(out))
    bags = " ".join(path.name for path in proposal.bags)
    lines = [
        f"# A first configuration, made by idim-iv init from {' '.join(bags.split())}.",
        "# Lists are in the order of robot.joints. A line that begins with # is a key that is left",
        "# out; behind its example: what it means, and what holds without it. All keys at length:",
        "# docs/configuration.md.",
    ]
    for section, kind in SECTIONS.items():
        given = values.get(section, {})
        lines += ["", f"{section}:" if given else f"# {section}:"]
        for name, field in kind.model_fields.items():
            lines.append(_line(proposal, section, name, field, given))
            if (section, name) == ("robot", "joints"):
                left_out = proposal.left_out.items()
                lines += [f"  # left out: {joint}: {reason}" for joint, reason in left_out]
    return signed("\n".join(lines) + "\n")


def write_configuration(proposal: Proposal, out: FilePath, *, force: bool = False) -> Path:
    """Write the proposal as a configuration file.

    Raises UsageError: it cannot be written, or a file of the user is in its place.
    """
    path = Path(out)
    require_replaceable([path], force=force)
    with refused_if_unwritable(path):
        write_together({path: configuration_text(proposal, path)})
    return path


def _line(
    proposal: Proposal, section: str, name: str, field: FieldInfo, given: dict[str, object]
) -> str:
    """A line of YAML for a key: with its value, or commented out with an example."""
    words, reason = field.json_schema_extra, proposal.reasons.get((section, name), "")
    assert isinstance(words, dict)
    about = f"{field.description}; default: {words['without']}" + (f". {reason}" if reason else "")
    if name in given:
        return f"  {_yaml(name, given[name])}  # {about}"
    example: object = words["example"]
    if (section, name) == ("controller", "torque_limit") and proposal.limits:
        example = list(proposal.limits)
    elif isinstance(example, list) and len(example) == 1 and isinstance(example[0], float):
        example = example * len(proposal.joints)
    return f"  # {_yaml(name, example)}  # {about}"


def _yaml(name: str, value: object) -> str:
    """``name: value`` in one line."""
    yaml, stream, mapping = YAML(), io.StringIO(), CommentedMap({name: value})
    yaml.default_flow_style, yaml.width = True, _WIDTH
    mapping.fa.set_block_style()
    yaml.dump(mapping, stream)
    return stream.getvalue().strip()
