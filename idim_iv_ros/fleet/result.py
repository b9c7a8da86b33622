"""The document fleet.json: what the bags of a fleet say together."""

import math
from dataclasses import dataclass, field
from typing import ClassVar, Final, Literal

from idim_iv_ros.documents import Document, Number
from idim_iv_ros.effects.cause import EffectParameter
from idim_iv_ros.fleet.bag_result import GapSummary, Status

FLEET_FORMAT: Final = "idim_iv_ros/fleet/1"

Attention = Literal["differs", "changed", "unsteady", "recordings", "none"]
WhyDiagnose = Literal["differs", "changed", "unsteady", "typical"]


@dataclass(frozen=True, kw_only=True)
class FleetBag:
    """One bag, and why it was not used; empty where it was."""

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
    """A cause that diagnoses named, of one sign and size.

    - `robots`: robots that have it; those that have the effect with another size are another cause
    - `of_type`: whether nearly all diagnosed robots that are ordinary for their type have it
    - `parameters`: mean over these robots of each number that half of them determine or more; the
      standard deviation is that of the mean, with what the robots differ by
    """

    effect: str
    kind: str
    joint: str | None
    robots: tuple[str, ...]
    of_type: bool
    parameters: dict[str, EffectParameter] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class FleetType:
    """The robots of one type.

    - `robots`, `bags`: number of robots with usable bags, and of the bags that were used
    - `diagnosed`: robots with a diagnosis; `causes`, `sentences`: what the diagnoses say together
    - `notes`: what could not be judged, and why
    """

    type: str
    robots: int
    bags: int
    quantities: tuple[TypeQuantity, ...]
    diagnosed: tuple[str, ...] = ()
    causes: tuple[CommonCause, ...] = ()
    notes: tuple[str, ...] = ()
    sentences: tuple[str, ...] = ()


@dataclass(frozen=True)
class AgreementTest:
    """Whether one set of parameters holds for all bags of a robot (F-test from R factors).

    `what`: ``all parameters`` or a group of them; `beyond_type`: whether a parameter of it differs
    from bag to bag more than in the other robots.
    """

    what: str
    p_value: Number
    beyond_type: bool


@dataclass(frozen=True, kw_only=True)
class RobotQuantity:
    """One quantity of one robot.

    - `value`, `low`, `high`: all bags in one regression, with a 95 % interval that covers how much
      bags differ
    - `distance`: distance from the other robots of the type, in standard deviations of that
      difference; where the quantity changed over time, of its value before. Null where nothing says
      what is ordinary
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
    - `p_value`: of the null hypothesis that nothing changed, the search over dates included
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
    """One robot.

    - `attention`: strongest reason to look at it: ``differs`` from its type, ``changed`` over time,
      ``unsteady`` from bag to bag, ``recordings`` that cannot be used; or ``none``
    - `reasons`: all reasons in sentences
    - `bags`, `not_used`: number of bags that were used, and of the others
    - `first`, `last`: times of the first and last bag that were used, null where unknown
    - `p_value`, `change_p_value`: of the null hypotheses that the robot is one of its type, and
      that nothing changed over time
    - `quantities`: in the order of its type's
    - `diagnosis`: of its last bag that was diagnosed
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
    agreement: tuple[AgreementTest, ...] = ()
    quantities: tuple[RobotQuantity, ...] = ()
    changes: tuple[ParameterChange, ...] = ()
    diagnosis: GapSummary | None = None


@dataclass(frozen=True)
class Screened:
    """A robot that deserves a diagnosis.

    `why`: ``typical`` ones represent their type; `bags`: URIs to diagnose, newest first.
    """

    robot: str
    type: str
    why: WhyDiagnose
    reason: str
    bags: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class FleetResult(Document):
    """What the bags of a fleet say together: fleet.json.

    - `false_discoveries`: largest expected share of false ones among the robots that differ, and
      among those that changed
    - `level`: level of all intervals
    - `robots`: what needs attention first; `bags`: in the order in which they were given
    - `screen`: which robots to diagnose
    - `limits`: what R factors cannot show
    """

    what: ClassVar[str] = "the result of a fleet"
    written_by: ClassVar[str] = "fleet"

    format: Literal["idim_iv_ros/fleet/1"] = FLEET_FORMAT
    false_discoveries: float
    level: float
    types: tuple[FleetType, ...]
    robots: tuple[FleetRobot, ...]
    bags: tuple[FleetBag, ...]
    screen: tuple[Screened, ...]
    limits: tuple[str, ...]
    software: dict[str, str] = field(default_factory=dict)
