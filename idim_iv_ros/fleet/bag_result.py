"""What is kept of one bag of a fleet: small, complete for the statistics, blind to other bags."""

import math
from dataclasses import dataclass, field
from typing import ClassVar, Final, Literal

import numpy as np

from idim_iv_ros.diagnosis.result import Verdict as GapVerdict
from idim_iv_ros.documents import Document, Matrix, Number
from idim_iv_ros.effects.cause import EffectParameter, Kind
from idim_iv_ros.identification.result import Estimator
from idim_iv_ros.statistics.verdict import Verdict

BAG_FORMAT: Final = "idim_iv_ros/bag/1"

Status = Literal["ok", "missing", "corrupt", "unusable"]


@dataclass(frozen=True)
class JointNoise:
    """Residual of one joint, N m (N for a prismatic joint).

    `rms`: of the bag's own estimate; `floor`: of the noise of the measured torque in the band of
    the rows, which no model explains.
    """

    joint: str
    rms: Number
    floor: Number


@dataclass(frozen=True)
class CauseSummary:
    """One accepted cause of a diagnosis.

    `shrinkage`: share of the torque gap above the noise floor that goes with it.
    """

    effect: str
    kind: Kind
    joint: str | None
    parameters: dict[str, EffectParameter] = field(default_factory=dict)
    shrinkage: float | None = None


@dataclass(frozen=True)
class GapSummary:
    """A diagnosis in short: verdict, accepted causes (strongest first), and one sentence."""

    verdict: GapVerdict
    causes: tuple[CauseSummary, ...] = ()
    sentence: str = ""


@dataclass(frozen=True, kw_only=True)
class BagResult(Document):
    """One bag: whose it is, whether it can be used, and what it says of the base parameters.

    Where `status` is not ``ok``, `reason` says why, and everything from `duration` on is empty or
    null as far as it is unknown.

    - `uri`: path or URL, as in the source of the fleet
    - `content`: digest of the content of the bag; equal contents are the same recording
    - `key`: digest of content, configuration with its robot description, and version of the code:
      the name under which the result is kept
    - `robot`, `type`: which robot, and of which model
    - `time`: start of the recording, ISO 8601, UTC: ``2026-03-01T12:00:00Z``; null where neither
      source nor stamps say it
    - `labels`: other columns of the manifest
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
    - `condition_number`: of the stacked regressor matrix
    - `verdict`, `sentence`: verdict on the identification in a word and in a sentence
    - `checks`: findings on the recording: losses, frozen channels, segments
    - `diagnosis`: where the bag was diagnosed
    """

    what: ClassVar[str] = "the result of a bag"
    written_by: ClassVar[str] = "fleet"

    format: Literal["idim_iv_ros/bag/1"] = BAG_FORMAT
    uri: str
    content: str
    key: str = ""
    robot: str = ""
    type: str = ""
    time: str | None = None
    labels: dict[str, str] = field(default_factory=dict)
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
