"""What an identification found: the document result.json, and the series that its report draws."""

from dataclasses import dataclass, field
from typing import ClassVar, Final, Literal

from idim_iv_ros.documents import Document, Matrix, Number, Unsaved
from idim_iv_ros.files import IDENTIFICATION_FORMAT
from idim_iv_ros.physical import PhysicalParameters
from idim_iv_ros.recording.recording import ClockQuality, FrozenStretches, Note
from idim_iv_ros.statistics.hypothesis import HypothesisTest
from idim_iv_ros.statistics.residuals import ResidualDiagnosis
from idim_iv_ros.statistics.verdict import OverallVerdict, Verdict
from idim_iv_ros.types import FloatArray

Estimator = Literal["idim-iv", "idim-ls"]

# Remarks on a parameter. The first where the 95 % interval lies below zero, and there is nothing
# in the parameter that may be negative; the second where the interval holds zero.
Remark = Literal["", "not significant", "physically impossible"]
IMPOSSIBLE: Final = "physically impossible"
NOT_SIGNIFICANT: Final = "not significant"
_INTERVAL = 1.96


@dataclass(frozen=True, kw_only=True)
class RefinedEstimate:
    """A base parameter of the refined estimate (equation 12).

    - `relative_std_percent`: 100 std / |value|, whatever is given; None where the value is zero
    - `ls_value`: joint-weighted IDIM-LS on the same rows
    """

    name: str
    expression: str
    unit: str
    value: Number
    std: Number
    relative_std_percent: float | None = None
    essential: bool
    ls_value: Number
    given_value: float | None

    def __post_init__(self) -> None:
        relative = 100.0 * self.std / abs(self.value) if self.value != 0.0 else None
        object.__setattr__(self, "relative_std_percent", relative)


@dataclass(frozen=True, kw_only=True)
class ParameterEstimate(RefinedEstimate):
    """A base parameter, estimated with all others; the standard deviation knows the
    autocorrelation of the residual.

    - `white_std`: what the deviation would be if the residual were white: too small when it is not
    - `essential_value`, `essential_std`: estimate with only the essential parameters in the model;
      None for the others
    - `ordinary_ls_value`: IDIM-LS with the same weight for all rows
    - `non_negative`: whether physics forbids a negative value
    - `remark`, `essential_remark`: what forbids to rely on `value` and on `essential_value`,
      whatever is given: `IMPOSSIBLE`, `NOT_SIGNIFICANT`, or nothing
    """

    white_std: Number
    essential_value: float | None
    essential_std: float | None
    ls_std: Number
    ordinary_ls_value: Number
    non_negative: bool = False
    remark: Remark = ""
    essential_remark: Remark = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "remark", self._remark(self.value, self.std))
        essential = self._remark(self.essential_value, self.essential_std)
        object.__setattr__(self, "essential_remark", essential)

    def _remark(self, value: float | None, std: float | None) -> Remark:
        if value is None or std is None:
            return ""
        if abs(value) < _INTERVAL * std:
            return NOT_SIGNIFICANT
        return IMPOSSIBLE if self.non_negative and value < 0.0 else ""


@dataclass(frozen=True)
class Refined:
    """Refined estimates with the autoregressive order of each joint's residual.

    `moved` names the essential parameters that whitening moves further than noise can.
    """

    ar_orders: tuple[int, ...]
    parameters: tuple[RefinedEstimate, ...]
    moved: tuple[str, ...] = ()


@dataclass(frozen=True)
class InstrumentReport:
    """Where the instruments came from and what the tests say of them.

    - `accepted`: whether Π = I is accepted at all joints; None where it could not be tested
    - `source`: in words; for IDIM-LS that there are none
    - `failures`: sources that were tried before and failed, with the reason
    """

    accepted: bool | None
    alpha: float
    source: str
    failures: tuple[str, ...]
    notes: tuple[str, ...]
    tests: tuple[HypothesisTest, ...]


@dataclass(frozen=True, kw_only=True)
class JointTests:
    """Outcomes of a statistical test at all joints, and over all rows.

    - `accepted`: the outcome over all rows, whatever is given; None where there is none
    """

    accepted: bool | None = None
    alpha: float
    tests: tuple[HypothesisTest, ...]

    def __post_init__(self) -> None:
        overall = next((test.accepted for test in self.tests if test.scope == "all"), None)
        object.__setattr__(self, "accepted", overall)


@dataclass(frozen=True, kw_only=True)
class JointResidual(ResidualDiagnosis):
    """The residual of one joint and the verdict on its estimates.

    - `verdict`, `sentence`: for programs, and in words
    - `rows`: over which `rms` is taken; None in an older document
    - `mean_square_freedom`: degrees of freedom that one row adds to the mean square of the residual
      (1: independent and Gaussian), by its scatter from second to second; None where that is not
      known
    """

    verdict: Verdict
    sentence: str
    rows: int | None = None
    mean_square_freedom: float | None = None


@dataclass(frozen=True)
class FittedGain:
    """A gain of a control law that was fitted to the recording."""

    joint: str
    term: str
    value: Number
    std: Number
    r_squared: Number


@dataclass(frozen=True)
class Fit:
    """How well the model describes the torque.

    - `relative_error_percent`: 100 ‖y - X β̂‖ / ‖y‖ over the rows that count
    - `ls_relative_error_percent`: the same for joint-weighted IDIM-LS
    - `condition_number`: of the stacked, unweighted regressor matrix
    - `essential_p_value`: F-test of the null hypothesis that the parameters that are not essential
      are zero
    - `joint_relative_error_percent`: dict of joint to float or None, 100 ‖y_j - X_j β̂‖ / ‖y_j‖ of
      each joint; None where its torque is zero
    """

    relative_error_percent: Number
    ls_relative_error_percent: Number
    condition_number: Number
    samples: int
    base_parameters: int
    essential_parameters: int
    essential_p_value: Number
    joint_relative_error_percent: dict[str, float | None] = field(default_factory=dict)


@dataclass(frozen=True)
class BagSummary:
    """What was read of a recording, and what was dropped.

    - `rate`, `duration`: Hz, s
    - `session_start`: of this recording in the time of the session, s
    - `dropped`: decimated joint samples that do not count, by reason
    - `frozen`: channels that held their last value while the joint moved
    """

    path: str
    rate: float
    duration: float
    samples: int
    signals: tuple[str, ...]
    clocks: tuple[ClockQuality, ...]
    notes: tuple[Note, ...]
    dropped: dict[str, int]
    frozen: tuple[FrozenStretches, ...] = ()
    session_start: float = 0.0


@dataclass(frozen=True)
class ProcessingSummary:
    """Filters as they were applied, and why.

    Frequencies in Hz, `minimum_speed` in rad/s (m/s for prismatic joints); one of
    `decimation_factors` for each recording; `advice` says what to add to the configuration.
    """

    position_cutoff: float
    position_order: int
    decimation_cutoff: float
    decimation_factors: tuple[int, ...]
    row_rate: float
    minimum_speed: tuple[float, ...]
    reasons: tuple[str, ...]
    advice: tuple[str, ...] = ()


@dataclass(frozen=True)
class JointSeries:
    """Torque of one joint over time, for plots.

    `time` (n,) s: of the session (`recording.Session`): it increases. `measured`, `predicted` (n,)
    N m: decimated torque and X β̂ of the rows that count; the others are gaps in time.
    """

    joint: str
    time: FloatArray
    measured: FloatArray
    predicted: FloatArray


@dataclass(frozen=True, kw_only=True)
class IdentificationResult(Document):
    """Outcome of an identification: result.json, and what its report draws.

    Attributes
    ----------
    exogeneity : JointTests
        All rows first, then joint by joint.
    specification : JointTests
        Whether the residual follows position, speed or acceleration, joint by joint.
    controller : tuple of str
        The control law that was fitted, in words; `fitted_gains` holds its numbers.
    doubts : tuple of str
        What makes the nominal model, or the signals of a joint, hard to believe.
    covariance : (b, b)
        Of the estimates in `parameters`, in their order and the products of their units; the
        diagonal holds the squares of their `std`.
    physical : PhysicalParameters or None
        Nearest to the refined estimate.
    why_no_physical : str
        Why there are none; empty where there are.
    kinematics : str
        Digest of the geometry (`kinematics_digest`): to which URDF the result belongs.
    timing : dict of str to float
        Seconds by stage.
    series : tuple of JointSeries
        For the report and not in the document.
    """

    what: ClassVar[str] = "an identification"
    written_by: ClassVar[str] = "identify"

    format: Literal["idim_iv_ros/identification/1"] = IDENTIFICATION_FORMAT
    robot: str
    joints: tuple[str, ...]
    joint_types: tuple[str, ...]
    bags: tuple[BagSummary, ...]
    software: dict[str, str]
    estimator: Estimator
    iterations: int
    converged: bool
    convergence_note: str
    verdict: OverallVerdict
    parameters: tuple[ParameterEstimate, ...]
    instruments: InstrumentReport
    specification: JointTests
    exogeneity: JointTests
    residuals: tuple[JointResidual, ...]
    fit: Fit
    refined: Refined | None
    processing: ProcessingSummary
    controller: tuple[str, ...]
    fitted_gains: tuple[FittedGain, ...]
    doubts: tuple[str, ...] = ()
    effort_unit: str
    covariance: Matrix = field(compare=False)
    configuration: dict[str, object]
    physical: PhysicalParameters | None = None
    why_no_physical: str = ""
    kinematics: str = ""
    timing: dict[str, Number] = field(default_factory=dict)
    series: Unsaved[tuple[JointSeries, ...]] = field(default=(), compare=False)
