"""The format of gap.json, and the check of a file that claims to have it."""

import json
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from idim_iv_ros.diagnosis.result import FORMAT, Family, Kind, Verdict
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import FilePath, read_text
from idim_iv_ros.report.json_result import Document

_LARGEST_FILE = 50.0  # MB

Number = Annotated[float, Field(allow_inf_nan=False)]
Interval = tuple[Number | None, Number | None]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, strict=True)


class ParameterPart(_Part):
    """A number of an effect or of the extended model."""

    value: Number
    std: Number | None
    unit: str


class EvidencePart(_Part):
    """Why an effect is believed."""

    statistic: Number | None
    p_value: Number | None
    held_out_gain: Number | None
    folds_positive: str


class IndistinguishablePart(_Part):
    """An effect that explains the recording as well."""

    effect: str
    joint: str | None
    correlation: Number | None


class SimulationGapPart(_Part):
    """Tracking error, before and after."""

    before: Number | None
    after: Number | None
    shrinkage: Number | None
    ci95: Interval | None


class TorqueGapPart(SimulationGapPart):
    """Torque gap, before and after."""

    noise_floor: Number | None


class JointChangePart(_Part):
    """What a cause takes of the torque gap at one joint."""

    joint: str
    before: Number | None
    after: Number | None
    share_of_torque: Number | None


class ParameterErrorPart(_Part):
    """What parameter errors make of the nominal model's torque gap at one joint."""

    joint: str
    given: Number | None
    named: Number | None
    refit: Number | None
    remaining: Number | None
    share_of_torque: Number | None


class CausePart(_Part):
    """One accepted cause."""

    effect: str
    kind: Kind
    joint: str | None
    other_joint: str | None
    sentence: str
    parameters: dict[str, ParameterPart]
    evidence: EvidencePart
    indistinguishable_from: list[IndistinguishablePart]
    torque_gap: TorqueGapPart
    joint_gaps: list[JointChangePart] = []
    simulation_gap: SimulationGapPart | None


class UnexplainedPart(_Part):
    """What no effect of the catalogue explains."""

    joint: str
    family: Family
    share: Number | None
    where: str


class JointPart(_Part):
    """The gap at one joint."""

    joint: str
    rms: Number
    relative_percent: Number | None
    share: Number | None
    noise_floor: Number | None
    floor_origin: str


class RegimePart(_Part):
    """Part of one joint's samples; an open end is null."""

    joint: str
    axis: str
    low: Number | None
    high: Number | None
    unit: str
    energy_share: Number | None
    occupancy: Number | None
    lift: Number | None
    ci95: Interval | None


class WherePart(_Part):
    """Where the gap lies."""

    joints: list[JointPart]
    regimes: list[RegimePart]


class NotTestablePart(_Part):
    """An effect that the recording cannot show."""

    effect: str
    joint: str | None
    reason: str
    excitation_needed: str
    smallest: str


class StagePart(_Part):
    """One model on the way from the given to the extended one."""

    stage: str
    torque_rms: dict[str, Number | None]
    torque_ci95: dict[str, Interval]
    tracking_rms: dict[str, Number | None] | None
    note: str


class SessionPartPart(_Part):
    """Where one recording lies in the time of the session, s."""

    bag: str
    start: Number
    duration: Number


class SignalChainPart(_Part):
    """What lies between the law and the torque."""

    effort_shift: ParameterPart
    periods: Number
    joint_shifts: dict[str, ParameterPart]
    differing: list[str]
    law_speed: str | None


class GapFile(_Part):
    """The whole file."""

    format: Literal["idim_iv_ros/gap/1"]
    robot: str
    joints: list[str]
    bags: list[str]
    session: list[SessionPartPart] = []
    software: dict[str, str]
    without: list[str]
    verdict: Verdict
    summary: str
    causes: list[CausePart]
    unexplained: UnexplainedPart | None
    parameter_errors: list[ParameterErrorPart] = []
    signal_chain: SignalChainPart | None = None
    where: WherePart
    findings: list[str]
    not_testable: list[NotTestablePart]
    stages: list[StagePart]
    notes: list[str]
    extended_parameters: dict[str, ParameterPart]
    configuration: dict[str, object]
    timing: dict[str, Number | None]


def check_gap_text(text: str, name: str) -> Document:
    """Return the content of gap.json after checking its format.

    Keys that are not known are left alone: a later version may have more.

    Parameters
    ----------
    text : str
    name : str
        Of the file, for the message.

    Raises
    ------
    UsageError
        Not JSON, another format, or a key that is missing or wrong; the message names it.
    """
    try:
        document = json.loads(text)
    except ValueError as error:
        raise UsageError(f"{name}: not JSON: {error}") from error
    found = document.get("format") if isinstance(document, dict) else None
    if found != FORMAT:
        raise UsageError(f"{name}: not a diagnosis: format is {found!r}, not {FORMAT!r}")
    try:
        # From the text, so that a JSON list may stand for a tuple.
        GapFile.model_validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise UsageError(f"{name}: {key}: {first['msg']}") from error
    checked: Document = document
    return checked


def read_gap(path: FilePath) -> Document:
    """Read gap.json and check its format.

    Raises
    ------
    UsageError
        The file cannot be read, or as `check_gap_text`.
    """
    path = Path(path)
    text = read_text(path, "the diagnosis", megabytes=_LARGEST_FILE)
    return check_gap_text(text, str(path))
