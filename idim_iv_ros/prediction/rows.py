"""The residual at decimated rows, as the identification has it, and its size over some time."""

import math
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.model.parameters import unit_at
from idim_iv_ros.prediction.identified_model import IdentifiedModel
from idim_iv_ros.statistics.residuals import largest_share
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

LEVEL_SECONDS = 10.0  # of rows that count, by which the residual is compared with its floor
SHARE, LIMIT = "residual over noise floor", "explained up to"  # keys of its diagnostics
_KEPT = 60.0  # s in which they are looked for
_SAME_RATE = 1.1  # ratio of two rates that have the same noise floor
_DAY = 86_400.0  # s


class ResidualRows:
    """The newest rows.

    - `places`: (r,) int, numbers of their samples on the grid
    - `residual`: (r, n_joints) N m (N)
    - `counts`: (r, n_joints) bool, whether the identification would use the row: measured, and not
      near a reversal
    - `variance`: (r, n_joints) (N m)² (N²), that the uncertainty of the parameters gives the
      prediction
    """

    def __init__(self, joints: int, rate: float) -> None:
        self.rate = rate
        self.places: IntArray = np.zeros(0, np.int64)
        self.residual: FloatArray = np.zeros((0, joints))
        self.counts: BoolArray = np.zeros((0, joints), dtype=bool)
        self.variance: FloatArray = np.zeros((0, joints))

    def add(self, **new: IntArray | FloatArray | BoolArray) -> None:
        """Append rows, and give up those that nothing asks for any more."""
        for name, rows in new.items():
            both = np.concatenate([getattr(self, name), rows])
            setattr(self, name, both[-round(_KEPT * self.rate) :])

    def share(self, seconds: float, least: int) -> FloatArray:
        """RMS (n_joints,) N m (N) over the rows of the last seconds that count.

        NaN where these are fewer than `least`.
        """
        newest = slice(-max(1, round(seconds * self.rate)), None)
        counts = self.counts[newest]
        square = np.where(counts, self.residual[newest], 0.0) ** 2
        number = counts.sum(axis=0)
        mean = square.sum(axis=0) / np.maximum(number, 1)
        return np.where(number >= max(least, 1), np.sqrt(mean), np.nan)


@dataclass(frozen=True)
class JointLevel:
    """The residual of one joint beside that of the identification."""

    joint: str
    unit: str
    # rms, noise_floor: Over the newest rows that count, and of the identification; NaN
    # without rows
    rms: float
    noise_floor: float
    rows: int
    seconds: float  # That these rows make
    limit: float | None  # RMS over noise floor that scatter explains; None where it is not known
    why_no_limit: str

    @property
    def share(self) -> float:
        """RMS over noise floor."""
        return self.rms / self.noise_floor if self.noise_floor > 0.0 else float("nan")

    @property
    def beyond(self) -> bool:
        """Whether the model does not fit any more, or not this motion."""
        return self.limit is not None and self.share > self.limit

    @property
    def sentence(self) -> str:
        """What the residual of the joint says of the model."""
        if self.rows == 0:
            return "no motion to judge by: at rest, or nothing measured"
        much = (
            f"residual {self.rms:.3g} {self.unit} RMS over {self.seconds:.1f} s of motion, "
            f"{self.share:.2f} times the identification's"
        )
        if self.limit is None:
            return f"{much}; {self.why_no_limit}"
        explained = f"scatter and uncertain parameters explain up to {self.limit:.2f}"
        if self.beyond:
            return (
                f"{much}; {explained}: the model does not fit any more, or not in this motion; "
                "record it and identify anew"
            )
        return f"{much}; {explained}"


def joint_levels(
    identified: IdentifiedModel, rows: ResidualRows, rate: float, false_warnings: float
) -> tuple[JointLevel, ...]:
    """Compare every joint's residual with that of the identification.

    - `rate`: of the samples, Hz: noise of efforts that are sampled more slowly folds into the band
      of the motion, so that the noise floor is that of its rate
    - `false_warnings`: how many of them a day of motion are accepted while the model fits, all
      joints together
    """
    result, joints = identified.result, len(identified.joints)
    probability = min(0.5, false_warnings * LEVEL_SECONDS / _DAY / joints)
    other_rate = _other_rate(identified, rate)
    levels = []
    for place, (joint, residual) in enumerate(
        zip(identified.joints, result.residuals, strict=True)
    ):
        newest = np.flatnonzero(rows.counts[:, place])[-round(LEVEL_SECONDS * rows.rate) :]
        count, variance = len(newest), float(rows.variance[newest, place].sum())
        energy = float(np.sum(rows.residual[newest, place] ** 2))
        freedom, limit, why = residual.mean_square_freedom, None, ""
        if other_rate:
            why = f"no limit: {other_rate}"
        elif freedom is None or residual.rows is None:
            why = (
                "no limit: the result does not hold how its residual scatters, for which ten "
                "seconds of motion are needed"
            )
        else:
            floor = max(count, 1) * residual.rms**2
            errors = variance / floor if floor > 0.0 else 0.0
            limit = largest_share(freedom, residual.rows, count, probability, errors)
        levels.append(
            JointLevel(
                joint=joint,
                unit=unit_at("N m", result.joint_types[place], result.effort_unit),
                rms=math.sqrt(energy / count) if count else math.nan,
                noise_floor=residual.rms,
                rows=count,
                seconds=count / rows.rate,
                limit=limit,
                why_no_limit=why,
            )
        )
    return tuple(levels)


def _other_rate(identified: IdentifiedModel, rate: float) -> str:
    """Say so where the samples come at another rate than those of the identification."""
    rates = {bag.rate for bag in identified.result.bags}
    if not rates or any(1.0 / _SAME_RATE < rate / other < _SAME_RATE for other in rates):
        return ""
    listed = ", ".join(f"{rate:.4g}" for rate in sorted(rates))
    return (
        f"samples come at {rate:.4g} Hz and those of the identification at {listed} Hz, whose "
        "noise floor is another one"
    )
