"""A result.json as a model that predicts, and its residual compared with the noise floor."""

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from idim_iv_ros.configuration import Configuration, ProcessingSection
from idim_iv_ros.errors import UsageError
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.model import InverseModel, require_same_robot
from idim_iv_ros.model.parameters import unit_at
from idim_iv_ros.signals.joint_side import JointTransform, joint_transform
from idim_iv_ros.statistics.residuals import largest_share
from idim_iv_ros.types import BoolArray, FloatArray, IntArray
from idim_iv_ros.validation import first_problem

# Keys that must have the values of the identification, on which the parameters depend.
_SAME = {
    "robot": ("gravity", "position_offset", "motor_to_joint", "motor_to_joint_torque", "couplings"),
    "signals": ("effort_scale", "effort_unit"),
    "identification": ("friction", "drive_inertia", "exclude"),
}


@dataclass(frozen=True)
class IdentifiedModel:
    """Model, parameters and filters of one identification."""

    path: Path  # of the result.json
    result: IdentificationResult
    model: InverseModel
    transform: JointTransform  # from quantities of the topics to those of the joints
    values: FloatArray  # (b,): Base parameters
    processing: ProcessingSection  # filters of the identification

    @property
    def joints(self) -> tuple[str, ...]:
        """Return the joints, in the order of all arrays."""
        return self.result.joints

    @cached_property
    def noise_floor(self) -> FloatArray:
        """Return the RMS of the identification's residual, (n_joints,) N m (N)."""
        return np.array([residual.rms for residual in self.result.residuals])


def identified_model(
    path: Path, configuration: Configuration, model: InverseModel, source: str
) -> IdentifiedModel:
    """Read a result.json and check that it belongs to this robot and configuration.

    `model` is that of the configuration (`build_inverse_model`), `source` the name of its URDF.
    Raises UsageError: it cannot be read, or is of another robot, URDF or configuration.
    """
    result = IdentificationResult.read(path)
    require_same_robot(path, result, configuration, model.robot, source)
    wrong = []
    now = configuration.model_dump(mode="json", exclude_none=True)
    for section, keys in _SAME.items():
        then = result.configuration.get(section)
        before = then if isinstance(then, dict) else {}
        others = [key for key in keys if before.get(key) != now[section].get(key)]
        given = configuration.source or "the configuration"
        wrong += [f"it was identified with another {section}.{k} than {given} has" for k in others]
    values = np.array([parameter.value for parameter in result.parameters])
    if tuple(item.name for item in result.parameters) != model.base.names:
        wrong.append(f"its base parameters are not those of {source}")
    if not np.isfinite(values).all():
        wrong.append("a parameter has no value")
    if wrong:
        raise UsageError(f"{path}: {wrong[0]}; run `idim-iv identify` again")
    try:
        processing = ProcessingSection.model_validate(result.configuration.get("processing") or {})
    except ValidationError as error:
        raise UsageError(f"{path}: configuration.processing: {first_problem(error)}") from error
    transform = joint_transform(configuration)
    return IdentifiedModel(path, result, model, transform, values, processing)


LEVEL_SECONDS = 10.0  # of rows that count, by which the residual is compared with its floor
SHARE, LIMIT = "residual over noise floor", "explained up to"  # keys of its diagnostics
_KEPT = 60.0  # s in which they are looked for
_SAME_RATE = 1.1  # ratio of two rates that have the same noise floor
_DAY = 86_400.0  # s


class ResidualRows:
    """The newest rows of the residual, decimated as in the identification.

    `places` (r,): numbers of their samples. `residual` (r, n_joints) N m (N). `counts` (r,
    n_joints): whether a row is measured and not near a reversal. `variance` (r, n_joints) (N m)²
    (N²): of the prediction by the uncertainty of the parameters.
    """

    def __init__(self, joints: int, rate: float) -> None:
        self.rate = rate
        self.places: IntArray = np.zeros(0, np.int64)
        self.residual: FloatArray = np.zeros((0, joints))
        self.counts: BoolArray = np.zeros((0, joints), dtype=bool)
        self.variance: FloatArray = np.zeros((0, joints))

    def add(self, **new: IntArray | FloatArray | BoolArray) -> None:
        """Append rows, and drop those older than a minute."""
        for name, rows in new.items():
            merged = np.concatenate([getattr(self, name), rows])
            setattr(self, name, merged[-round(_KEPT * self.rate) :])

    def share(self, seconds: float, least: int) -> FloatArray:
        """Return the RMS (n_joints,) N m (N) of the rows that count in the last seconds.

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
    """The residual of one joint compared with that of the identification."""

    joint: str
    unit: str
    rms: float  # over the newest rows that count; NaN without rows
    noise_floor: float  # RMS of the identification
    rows: int
    seconds: float  # of motion in these rows
    limit: float | None  # of RMS over noise floor by scatter; None if unknown
    why_no_limit: str

    @property
    def share(self) -> float:
        """Return RMS over noise floor."""
        return self.rms / self.noise_floor if self.noise_floor > 0.0 else float("nan")

    @property
    def beyond(self) -> bool:
        """Return whether the residual exceeds its limit: the model does not fit."""
        return self.limit is not None and self.share > self.limit

    @property
    def sentence(self) -> str:
        """Return a sentence on the residual of the joint and whether the model fits."""
        if self.rows == 0:
            return "no motion to judge by: at rest, or nothing measured"
        much = (
            f"residual {self.rms:.3g} {self.unit} RMS over {self.seconds:.1f} s of motion, "
            f"{self.share:.2f} times the identification's"
        )
        if self.limit is None:
            return f"{much}; {self.why_no_limit}"
        explained = f"{much}; scatter and uncertain parameters explain up to {self.limit:.2f}"
        if not self.beyond:
            return explained
        advice = "the model does not fit any more, or not in this motion; record it"
        return f"{explained}: {advice} and identify anew"


def joint_levels(
    identified: IdentifiedModel, rows: ResidualRows, rate: float, false_warnings: float
) -> tuple[JointLevel, ...]:
    """Compare every joint's residual with that of the identification.

    - `rate`: sampling rate, Hz; with another rate than the identification's the noise floor is
      another (noise folds into the band of the motion), and there is no limit
    - `false_warnings`: accepted number a day of motion while the model fits, of all joints
    """
    result, joints = identified.result, len(identified.joints)
    probability = min(0.5, false_warnings * LEVEL_SECONDS / _DAY / joints)
    rates = sorted({bag.rate for bag in result.bags})
    other_rate = rates and not any(1.0 / _SAME_RATE < rate / r < _SAME_RATE for r in rates)
    levels = []
    pairs = zip(identified.joints, result.residuals, strict=True)
    for place, (joint, residual) in enumerate(pairs):
        newest = np.flatnonzero(rows.counts[:, place])[-round(LEVEL_SECONDS * rows.rate) :]
        count, variance = len(newest), float(rows.variance[newest, place].sum())
        energy = float(np.sum(rows.residual[newest, place] ** 2))
        freedom, limit, why = residual.mean_square_freedom, None, ""
        if other_rate:
            why = (
                f"no limit: samples come at {rate:.4g} Hz and those of the identification at "
                f"{', '.join(f'{r:.4g}' for r in rates)} Hz, whose noise floor is another one"
            )
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
