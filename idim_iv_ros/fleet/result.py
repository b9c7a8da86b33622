"""Documents of a fleet: the result of one bag, and fleet.json with the comparison of all."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np

from idim_iv_ros.diagnosis.result.document import Verdict as GapVerdict
from idim_iv_ros.documents import Document, Matrix, Number
from idim_iv_ros.effects.cause import EffectParameter, Kind
from idim_iv_ros.files import complete_files, refused_if_unwritable
from idim_iv_ros.identification.result import Estimator
from idim_iv_ros.statistics.verdict import Verdict

Status = Literal["ok", "missing", "corrupt", "unusable"]
TABLE = "fleet.parquet"
_COLUMNS = (
    *("uri", "robot", "type", "time", "status", "reason", "duration", "rows", "estimator"),
    *("verdict", "parameter", "unit", "value", "std", "given", "content"),
)


@dataclass(frozen=True)
class JointNoise:
    """Residual of one joint, N m (N for a prismatic joint).

    `rms`: RMS of the bag's residual; `floor`: noise of the measured torque in the band of the rows,
    which no model explains.
    """

    joint: str
    rms: Number
    floor: Number


@dataclass(frozen=True)
class CauseSummary:
    """One cause in the summary of a diagnosis.

    `shrinkage`: share of the torque gap above the noise floor that the cause removes.
    """

    effect: str
    kind: Kind
    joint: str | None
    parameters: dict[str, EffectParameter] = field(default_factory=dict)
    shrinkage: float | None = None


@dataclass(frozen=True)
class GapSummary:
    """Summary of a diagnosis: verdict, causes (strongest first), and one sentence."""

    verdict: GapVerdict
    causes: tuple[CauseSummary, ...] = ()
    sentence: str = ""


@dataclass(frozen=True, kw_only=True)
class BagResult(Document):
    """Result of one bag: its robot, whether it can be used, and its base parameters.

    Where `status` is not ``ok``, `reason` says why, and everything from `duration` on is empty or
    null as far as it is unknown.

    - `uri`: path or URL, as in the source of the fleet
    - `content`: digest of the content of the bag; equal contents are the same recording
    - `key`: digest of content, configuration with its robot description, and version of the code:
      the name under which the result is kept
    - `robot`, `type`: which robot, and of which model
    - `time`: start of the recording, ISO 8601, UTC: ``2026-03-01T12:00:00Z``; null where neither
      source nor stamps say it
    - `status`: ``ok``; ``missing``: no such file; ``corrupt``: cannot be read; ``unusable``: can be
      read and supports no estimate
    - `duration`: s; `samples`: number of rows that count, by joint
    - `names`, `expressions`, `units`: (p,), of the base parameters
    - `kinematics`: digest of the geometry: base parameters of bags are comparable where it is equal
    - `r_factor`: (p + 1, p + 1), upper triangular R of the whitened [X y]: RᵀR has XᵀWX, XᵀWy and
      yᵀWy, where W is the inverse of the covariance of the residual as an autoregressive process,
      joint by joint. Divided by its deviation, so that the whitened residual has variance one
    - `rows`: number of whitened rows behind `r_factor`
    - `estimator`: ``idim-iv`` where the instruments were accepted, else ``idim-ls``, and
      `why_least_squares` says why
    - `values`, `std`: (p,), estimate of this bag alone and its deviations, which know the
      autocorrelation of the residual; in `units`. Of a bag in segments IDIM-IV is the average
      weighted by covariance, and IDIM-LS that of the whitened rows of all
    - `given`: (p,), values of the nominal model; null where there are none
    - `condition_number`: that of the stacked regressor matrix
    - `verdict`, `sentence`: verdict on the identification in a word and in a sentence
    - `checks`: findings on the recording: losses, frozen channels, segments
    - `diagnosis`: where the bag was diagnosed
    """

    what: ClassVar[str] = "the result of a bag"
    written_by: ClassVar[str] = "fleet"

    format: Literal["idim_iv_ros/bag/1"] = "idim_iv_ros/bag/1"
    uri: str
    content: str
    key: str = ""
    robot: str = ""
    type: str = ""
    time: str | None = None
    status: Status
    reason: str = ""
    duration: Number = math.nan
    samples: dict[str, int] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    expressions: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    kinematics: str = ""
    effort_unit: str = "N m"
    r_factor: Matrix = field(default_factory=lambda: np.zeros((0, 0)), compare=False)
    rows: int = 0
    noise: tuple[JointNoise, ...] = ()
    estimator: Estimator = "idim-iv"
    why_least_squares: str = ""
    values: tuple[Number, ...] = ()
    std: tuple[Number, ...] = ()
    given: tuple[Number, ...] | None = None
    condition_number: Number = math.nan
    verdict: Verdict | None = None
    sentence: str = ""
    checks: tuple[str, ...] = ()
    diagnosis: GapSummary | None = None

    def __post_init__(self) -> None:
        width = len(self.names) + 1 if self.names else 0
        if not self.r_factor.size:  # an empty list of JSON has no second dimension
            object.__setattr__(self, "r_factor", np.zeros((width, width)))
        for name in ("expressions", "units", "values", "std"):
            if len(getattr(self, name)) != len(self.names):
                raise ValueError(f"{name}: {len(self.names)} are needed, one a base parameter")
        if self.r_factor.shape != (width, width):
            raise ValueError(f"r_factor: {self.r_factor.shape} is not ({width}, {width})")


Attention = Literal["differs", "changed", "unsteady", "recordings", "none"]
WhyDiagnose = Literal["differs", "changed", "unsteady", "typical"]


@dataclass(frozen=True, kw_only=True)
class FleetBag:
    """One bag of the fleet; `why_not` says why it was not used, or is empty."""

    uri: str
    robot: str
    type: str
    time: str | None
    status: Status
    used: bool
    why_not: str = ""
    duration: Number = math.nan


@dataclass(frozen=True, kw_only=True)
class TypeQuantity:
    """A base parameter, or the residual of a joint, over the robots of a type.

    Residuals (`kind` residual) scatter by factors: `mean` is their geometric mean, and `sigma` and
    `between_bags` are relative, 0.1 for a tenth.

    - `robots`: number of robots behind the numbers; `left_out`: robots that differ in the quantity
    - `mean`, `mean_low`, `mean_high`: mean with its 95 % interval
    - `sigma`, `sigma_low`, `sigma_high`: standard deviation from robot to robot, 95 % interval
    - `next_low`, `next_high`: 95 % prediction interval of the next robot's true value
    - `between_bags`: standard deviation from bag to bag of a robot, beyond the noise of a bag; null
      where no robot has two bags, and then it is part of `sigma`
    - `given`: value in the nominal model; null for residuals
    """

    name: str
    kind: Literal["parameter", "residual"]
    expression: str
    unit: str
    robots: int
    left_out: tuple[str, ...]
    mean: Number
    mean_low: Number
    mean_high: Number
    sigma: Number
    sigma_low: Number
    sigma_high: Number
    next_low: Number
    next_high: Number
    between_bags: Number
    given: Number


@dataclass(frozen=True)
class CommonCause:
    """A cause in the diagnoses of one or several robots, with equal sign and size.

    - `robots`: robots that have it; those that have the effect with another size are another cause
    - `of_type`: whether nearly all diagnosed robots that are ordinary for their type have it
    - `parameters`: mean over these robots of each number that half of them determine or more; the
      standard deviation is that of the mean, including the scatter of the robots
    """

    effect: str
    kind: str
    joint: str | None
    robots: tuple[str, ...]
    of_type: bool
    parameters: dict[str, EffectParameter] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class FleetType:
    """Results on the robots of one type.

    - `robots`, `bags`: number of robots with usable bags, and of the bags that were used
    - `diagnosed`: robots with a diagnosis; `causes`, `sentences`: common findings
    - `notes`: sentences on what could not be judged, and why
    """

    type: str
    robots: int
    bags: int
    quantities: tuple[TypeQuantity, ...]
    diagnosed: tuple[str, ...] = ()
    causes: tuple[CommonCause, ...] = ()
    notes: tuple[str, ...] = ()
    sentences: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class RobotQuantity:
    """One quantity of one robot.

    - `value`, `low`, `high`: estimate from all bags, with a 95 % interval that includes their
      scatter
    - `distance`: distance from the other robots of the type, in its standard deviations; where the
      quantity changed over time, of its value before. Null with too few robots
    - `p_value`: p-value of the null hypothesis that the robot is one of its type
    - `differs`: from the type at the fleet's false discovery rate; `changed`: over time;
      `unsteady`: from bag to bag, more than in other robots
    """

    name: str
    value: Number
    low: Number
    high: Number
    distance: Number
    p_value: Number
    differs: bool
    changed: bool
    unsteady: bool


@dataclass(frozen=True, kw_only=True)
class ParameterChange:
    """A change of one quantity of one robot over time.

    - `kind`: ``step``, or ``ramp``: it begins after the bag before `begin` and goes on to the last
    - `p_value`: p-value of the null hypothesis that nothing changed, the search over dates included
    - `begin`: time of the first bag that is changed, ISO 8601; `begin_low`, `begin_high`: it lies
      between these bags, 95 %
    - `before`, `after`: level before the change, and at the last bag
    - `size`, `size_low`, `size_high`: size of the change at the last bag; for residuals a factor
    - `times`, `values`, `stds`, `fitted`: of each bag; the standard deviations include what bags of
      an unchanged robot differ by
    """

    name: str
    kind: Literal["step", "ramp"]
    unit: str
    p_value: Number
    begin: str
    begin_low: str
    begin_high: str
    before: Number
    after: Number
    size: Number
    size_low: Number
    size_high: Number
    times: tuple[str, ...]
    values: tuple[Number, ...]
    stds: tuple[Number, ...]
    fitted: tuple[Number, ...]


@dataclass(frozen=True, kw_only=True)
class FleetRobot:
    """Results on one robot.

    - `attention`: strongest reason to look at it: ``differs`` from its type, ``changed`` over time,
      ``unsteady`` from bag to bag, ``recordings`` that cannot be used; or ``none``
    - `reasons`: all reasons in sentences
    - `bags`, `not_used`: number of bags that were used, and of the others
    - `first`, `last`: times of the first and last bag that were used, null where unknown
    - `p_value`, `change_p_value`: p-values of the null hypotheses that the robot is one of its
      type, and that nothing changed over time
    - `quantities`: in the order of its type's
    - `diagnosis`: that of its last diagnosed bag
    """

    robot: str
    type: str
    attention: Attention
    reasons: tuple[str, ...]
    bags: int
    not_used: int
    first: str | None = None
    last: str | None = None
    p_value: Number = math.nan
    change_p_value: Number = math.nan
    quantities: tuple[RobotQuantity, ...] = ()
    changes: tuple[ParameterChange, ...] = ()
    diagnosis: GapSummary | None = None

    @property
    def differs(self) -> bool:
        """Whether any quantity differs from the type's."""
        return any(quantity.differs for quantity in self.quantities)


@dataclass(frozen=True)
class Screened:
    """A robot to diagnose.

    `why`: ``typical`` ones represent their type; `bags`: URIs to diagnose, newest first.
    """

    robot: str
    type: str
    why: WhyDiagnose
    reason: str
    bags: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class FleetResult(Document):
    """Comparison of all robots of a fleet: the document fleet.json.

    - `false_discoveries`: largest expected share of false ones among the robots that differ, and
      among those that changed
    - `level`: level of all intervals
    - `robots`: sorted by attention; `bags`: in the order in which they were given
    - `screen`: which robots to diagnose
    """

    what: ClassVar[str] = "the result of a fleet"
    written_by: ClassVar[str] = "fleet"

    format: Literal["idim_iv_ros/fleet/1"] = "idim_iv_ros/fleet/1"
    false_discoveries: float
    level: float
    types: tuple[FleetType, ...]
    robots: tuple[FleetRobot, ...]
    bags: tuple[FleetBag, ...]
    screen: tuple[Screened, ...]
    software: dict[str, str] = field(default_factory=dict)


def time_of(text: str) -> datetime:
    """Return the time in an ISO 8601 text, UTC where it names no zone; ValueError if it is none."""
    # Python 3.10 knows no Z.
    time = datetime.fromisoformat(text[:-1] + "+00:00" if text.endswith(("Z", "z")) else text)
    return time if time.tzinfo else time.replace(tzinfo=timezone.utc)


def iso_time(time: datetime) -> str:
    """Return a time as ``2026-03-01T12:00:00Z``; a time without zone is UTC."""
    time = time if time.tzinfo else time.replace(tzinfo=timezone.utc)
    text = time.astimezone(timezone.utc).isoformat(timespec="microseconds")
    return text.replace("+00:00", "Z").replace(".000000Z", "Z")


def write_table(results: Sequence[BagResult], path: Path) -> None:
    """Write fleet.parquet: one row for each bag and base parameter, complete or not at all.

    Of the bag: `uri`, `robot`, `type`, `time` (start, UTC), `status`, `reason`, `duration` (s),
    `rows` (whitened, all joints), `estimator`, `verdict`, and `content`, its digest. Of the
    parameter: `parameter`, its name, and in its `unit` the `value` of this bag alone, `std` and
    `given`, that of the nominal model. A bag that is not ok has one row, without a parameter.

    Raises UsageError: it cannot be written, and why.
    """
    import pyarrow
    from pyarrow import parquet

    kinds = dict.fromkeys(("duration", "value", "std", "given"), pyarrow.float64())
    kinds |= {"time": pyarrow.timestamp("us", tz="UTC"), "rows": pyarrow.int64()}
    schema = pyarrow.schema(
        [pyarrow.field(name, kinds.get(name, pyarrow.string())) for name in _COLUMNS],
        metadata={"idim_iv_ros": "idim_iv_ros/fleet-table/1"},
    )
    rows = [row for result in results for row in _rows(result)]
    table = pyarrow.Table.from_pylist(rows, schema=schema)
    with refused_if_unwritable(path), complete_files([path]) as temporary:
        parquet.write_table(table, temporary[path])


def _rows(result: BagResult) -> list[dict[str, Any]]:
    names = ("uri", "robot", "type", "status", "duration", "verdict")
    common: dict[str, Any] = {name: getattr(result, name) for name in names}
    common |= {name: getattr(result, name) or None for name in ("reason", "content")}
    common |= {"time": time_of(result.time) if result.time is not None else None}
    rows = [common]
    if result.status == "ok":
        common |= {"rows": result.rows, "estimator": result.estimator}
        given = result.given or (None,) * len(result.names)
        columns = zip(result.names, result.units, result.values, result.std, given, strict=True)
        keys = ("parameter", "unit", "value", "std", "given")
        rows = [common | dict(zip(keys, column, strict=True)) for column in columns]
    for row in rows:
        missing = [key for key, v in row.items() if isinstance(v, float) and not math.isfinite(v)]
        row.update(dict.fromkeys(missing))
    return rows
