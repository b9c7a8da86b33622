"""What an identification found: plain values that are saved, compared and reported."""

from dataclasses import dataclass, field

from idim_iv_ros.files import IDENTIFICATION_FORMAT
from idim_iv_ros.recording import ClockQuality, FrozenStretches, Note
from idim_iv_ros.statistics import (
    HypothesisTest,
    JointVerdict,
    OverallVerdict,
    ResidualDiagnosis,
)
from idim_iv_ros.types import FloatArray

FORMAT = IDENTIFICATION_FORMAT

# Remarks on a parameter. The first where the 95 % interval lies below zero, and there is nothing
# in the parameter that may be negative; the second where the interval holds zero.
IMPOSSIBLE, NOT_SIGNIFICANT = "physically impossible", "not significant"
_INTERVAL = 1.96


@dataclass(frozen=True)
class ParameterEstimate:
    """One base parameter.

    Attributes
    ----------
    name, expression, unit : str
    value, std : float
        Estimate from all base parameters, and its standard deviation with the colour of the
        residual taken into account.
    relative_std_percent : float or None
        100 std / |value|.
    white_std : float
        What the deviation would be if the residual were white: too small when it is not.
    essential : bool
    essential_value, essential_std : float or None
        Estimate with only the essential parameters in the model; None for the others.
    ls_value, ls_std : float
        Joint-weighted IDIM-LS on the same rows.
    ordinary_ls_value : float
        IDIM-LS with all rows weighted alike.
    given_value : float or None
        What the URDF and the configuration hold.
    non_negative : bool
        Whether physics forbids a negative value.
    """

    name: str
    expression: str
    unit: str
    value: float
    std: float
    white_std: float
    essential: bool
    essential_value: float | None
    essential_std: float | None
    ls_value: float
    ls_std: float
    ordinary_ls_value: float
    given_value: float | None
    non_negative: bool = False

    @property
    def remark(self) -> str:
        """What forbids to rely on `value`: `IMPOSSIBLE`, `NOT_SIGNIFICANT`, or nothing."""
        return _remark(self.value, self.std, self.non_negative)

    @property
    def essential_remark(self) -> str:
        """The same of `essential_value`."""
        if self.essential_value is None or self.essential_std is None:
            return ""
        return _remark(self.essential_value, self.essential_std, self.non_negative)

    @property
    def relative_std_percent(self) -> float | None:
        """Standard deviation in percent of the value; None where the value is zero."""
        return 100.0 * self.std / abs(self.value) if self.value != 0.0 else None


@dataclass(frozen=True)
class RefinedEstimate:
    """A parameter of the refined estimate (equation 12)."""

    name: str
    expression: str
    unit: str
    value: float
    std: float
    essential: bool

    @property
    def relative_std_percent(self) -> float | None:
        """Standard deviation in percent of the value; None where the value is zero."""
        return 100.0 * self.std / abs(self.value) if self.value != 0.0 else None


@dataclass(frozen=True)
class Refined:
    """Refined estimates with the autoregressive order of each joint's residual."""

    ar_orders: tuple[int, ...]
    parameters: tuple[RefinedEstimate, ...]


@dataclass(frozen=True)
class InstrumentReport:
    """Where the instruments came from and what the tests say of them.

    Attributes
    ----------
    source : str
        In words; for IDIM-LS that there are none.
    accepted : bool or None
        Whether Π = I is accepted at all joints; None where it could not be tested.
    failures : tuple of str
        Sources that were tried before and failed, with the reason.
    notes : tuple of str
    tests, exogeneity : tuple of HypothesisTest
        All rows first, then joint by joint.
    specification : tuple of HypothesisTest
        Whether the residual follows position, speed or acceleration, joint by joint.
    """

    source: str
    accepted: bool | None
    alpha: float
    failures: tuple[str, ...]
    notes: tuple[str, ...]
    tests: tuple[HypothesisTest, ...]
    exogeneity: tuple[HypothesisTest, ...]
    specification: tuple[HypothesisTest, ...]


@dataclass(frozen=True)
class FittedGain:
    """One gain of a control law that was fitted to the recording."""

    joint: str
    term: str
    value: float
    std: float
    r_squared: float


@dataclass(frozen=True)
class Fit:
    """How well the model describes the torque.

    Attributes
    ----------
    relative_error_percent : float
        100 ‖y - X β̂‖ / ‖y‖ over the rows that count.
    ls_relative_error_percent : float
        The same for joint-weighted IDIM-LS.
    condition_number : float
        Of the stacked, unweighted observation matrix.
    samples : int
        Rows that count.
    base_parameters, essential_parameters : int
    essential_p_value : float
        F-test of the null hypothesis that the parameters that are not essential are zero.
    joint_relative_error_percent : dict of joint to float or None
        100 ‖y_j - X_j β̂‖ / ‖y_j‖ of each joint; None where its torque is zero.
    """

    relative_error_percent: float
    ls_relative_error_percent: float
    condition_number: float
    samples: int
    base_parameters: int
    essential_parameters: int
    essential_p_value: float
    joint_relative_error_percent: dict[str, float | None] = field(default_factory=dict)


@dataclass(frozen=True)
class BagSummary:
    """One recording: what was in it and what was dropped.

    Attributes
    ----------
    rate, duration
        Hz, s.
    session_start
        Of this recording in the time of the session, s.
    dropped : dict
        Decimated joint samples that do not count, by reason.
    frozen : tuple of FrozenStretches
        Channels that held their last value while the joint moved.
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

    Attributes
    ----------
    time : (n,) s
        Of the session (`recording.session`): it increases.
    measured, predicted : (n,) N m
        Decimated torque and X β̂ of the rows that count; the others are gaps in time.
    """

    joint: str
    time: FloatArray
    measured: FloatArray
    predicted: FloatArray


@dataclass(frozen=True)
class IdentificationResult:
    """Everything that `identify` found; `report` turns it into files.

    Attributes
    ----------
    covariance : (b, b)
        Of the estimates in `parameters`, in their order and the products of their units; the
        diagonal holds the squares of their `std`.
    doubts : tuple of str
        What makes the nominal model hard to believe.
    """

    robot: str
    joints: tuple[str, ...]
    joint_types: tuple[str, ...]
    effort_unit: str
    bags: tuple[BagSummary, ...]
    software: dict[str, str]
    configuration: dict[str, object]
    estimator: str
    iterations: int
    converged: bool
    convergence_note: str
    parameters: tuple[ParameterEstimate, ...]
    covariance: FloatArray
    instruments: InstrumentReport
    residuals: tuple[ResidualDiagnosis, ...]
    verdicts: tuple[JointVerdict, ...]
    verdict: OverallVerdict
    fit: Fit
    processing: ProcessingSummary
    controller: tuple[str, ...]
    fitted_gains: tuple[FittedGain, ...]
    refined: Refined | None
    series: tuple[JointSeries, ...]
    timing: dict[str, float] = field(default_factory=dict)
    doubts: tuple[str, ...] = ()


def _remark(value: float, std: float, non_negative: bool) -> str:
    if abs(value) < _INTERVAL * std:
        return NOT_SIGNIFICANT
    return IMPOSSIBLE if non_negative and value < 0.0 else ""
