"""From bags and a URDF to the values of a first configuration, each with its reason."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from threadpoolctl import threadpool_limits

from idim_iv_ros.configuration import Configuration, RobotSection, SignalsSection
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import FilePath, FilePaths, as_paths
from idim_iv_ros.first_configuration.joints import JointChoice, choose_joints
from idim_iv_ros.first_configuration.signals import EffortUnit, guess_effort_unit, propose_law
from idim_iv_ros.first_configuration.topics import (
    BagContents,
    TopicChoice,
    choose_states,
    choose_topics,
    read_contents,
)
from idim_iv_ros.identification.prepare import prepare, read_configured
from idim_iv_ros.model import read_urdf_file
from idim_iv_ros.model.urdf_reader import description_key
from idim_iv_ros.progress import Progress, Stopwatch


@dataclass(frozen=True)
class Proposal:
    """A first configuration.

    Attributes
    ----------
    bags : tuple of Path
    joints : tuple of str
        Those that are identified.
    urdf : Path or None
        None where the bag has /robot_description.
    values : dict
        Keys by section, the URDF left out: its path depends on where the file is written.
    reasons : dict of (str, str) to str
        Why a key of a section has its value, or has none.
    left_out : dict of str to str
        Joints that are not identified, and why.
    limits : tuple of float
        Effort limits of the URDF, N m (N), for `controller.torque_limit`; empty where it has none.
    warnings : tuple of str
    """

    bags: tuple[Path, ...]
    joints: tuple[str, ...]
    urdf: Path | None
    values: Mapping[str, Mapping[str, object]]
    reasons: Mapping[tuple[str, str], str]
    left_out: Mapping[str, str]
    limits: tuple[float, ...]
    warnings: tuple[str, ...]

    def values_for(self, out: Path) -> dict[str, dict[str, object]]:
        """Keys by section for a file at `out`, with the path of the URDF relative to it."""
        values = {section: dict(keys) for section, keys in self.values.items()}
        if self.urdf is not None:
            path = os.path.relpath(self.urdf.resolve(), out.resolve().parent)
            key = description_key(self.urdf)
            values["robot"] = {key: Path(path).as_posix(), **values["robot"]}
        return values


def propose_configuration(
    bags: FilePaths, urdf: FilePath | None = None, *, progress: Progress | None = None
) -> Proposal:
    """Look through bags and propose a configuration with which they can be identified.

    Parameters
    ----------
    bags
        One recording or several of one robot.
    urdf
        Its description; None: /robot_description of the bag.
    progress
        Called with a stage in words and the share that is done, 0 to 1.

    Raises
    ------
    UsageError
        No such file, no URDF, or one that cannot be used.
    DataError
        The bags hold nothing that can be identified.
    """
    paths = as_paths(bags)
    with threadpool_limits(limits=1, user_api="blas"), Stopwatch(progress) as watch:
        watch.stage("looking through the bag", 0.0)
        contents = [read_contents(path) for path in paths]
        text, source = _description(contents, None if urdf is None else Path(urdf))
        states, effort = choose_states(contents)
        joints = choose_joints(text, source, contents, states.name, (effort or states).name)
        topics = choose_topics(contents, joints.joints)
        watch.stage("reading", 0.3)
        configuration = _configuration(None if urdf is None else Path(urdf), joints, topics)
        prepared = prepare(read_configured(paths, configuration), configuration)
        watch.stage("effort unit", 0.6)
        unit = guess_effort_unit(prepared)
        watch.stage("control law", 0.8)
        law = propose_law(prepared.motions)
    signals: dict[str, object] = {"joint_states": topics.states.name}
    if topics.effort is not None:
        signals["effort"] = topics.effort.name
    if topics.reference is not None:
        signals["reference"] = topics.reference.name
    limits = prepared.model.robot.limits.effort
    finite = bool((limits > 0.0).all() and (limits < float("inf")).all())
    return Proposal(
        bags=paths,
        joints=joints.joints,
        urdf=None if urdf is None else Path(urdf),
        values={
            "robot": {"joints": list(joints.joints)},
            "controller": law.keys,
            "signals": {**signals, "effort_unit": unit.unit},
        },
        reasons={
            ("controller", "type"): law.reason,
            ("signals", "effort_unit"): unit.reason,
            **{("signals", key): reason for key, reason in topics.reasons.items()},
        },
        left_out=joints.left_out,
        limits=tuple(float(limit) for limit in limits) if finite and unit.unit == "N m" else (),
        warnings=joints.warnings + _unit_warning(unit),
    )


def _unit_warning(unit: EffortUnit) -> tuple[str, ...]:
    if unit.unit == "N m":
        return ()
    return (
        "the efforts are no torques: joints whose torque constants differ do not fit one model, "
        "and nothing can be compared with the URDF; give torque constant times gear ratio of each "
        "joint as signals.effort_scale, and effort_unit N m",
    )


def _description(contents: list[BagContents], urdf: Path | None) -> tuple[str, str]:
    """Text of the URDF, and what to call it."""
    if urdf is not None:
        return read_urdf_file(urdf), str(urdf)
    for bag in contents:
        if bag.description is not None:
            return bag.description, f"{bag.path.name} /robot_description"
    raise UsageError(
        f"{contents[0].path}: no /robot_description in the bag: give the robot's URDF with --urdf"
    )


def _configuration(urdf: Path | None, joints: JointChoice, topics: TopicChoice) -> Configuration:
    named = {} if urdf is None else {description_key(urdf): urdf}
    return Configuration(
        robot=RobotSection.model_validate({**named, "joints": list(joints.joints)}),
        signals=SignalsSection(
            joint_states=topics.states.name,
            effort=None if topics.effort is None else topics.effort.name,
            reference=None if topics.reference is None else topics.reference.name,
        ),
    )
