"""Design of a periodic motion that identifies all base parameters well."""

import time
from collections.abc import Iterator
from dataclasses import astuple, dataclass, replace
from typing import Literal

import numpy as np
import scipy

from idim_iv_ros.compilation import one_thread
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.estimation.qr import streamed_r_factor
from idim_iv_ros.excitation.limits import (
    LimitUse,
    MotionLimits,
    MovingFrames,
    limit_use,
    moving_frames,
    require_inside,
    require_reachable,
    use_within,
)
from idim_iv_ros.excitation.trajectory import (
    MOST_SAMPLES,
    FourierBasis,
    Trajectory,
    require_sampling,
)
from idim_iv_ros.model import InverseModel
from idim_iv_ros.progress import Progress
from idim_iv_ros.types import FloatArray

Criterion = Literal["condition", "precision"]

_STEP = 1e-6
# Speed, as a share of its limit, below which the sign of the Coulomb columns is smoothed.
_SMOOTH = 0.01


@dataclass(frozen=True)
class ExcitationCost:
    """Criterion on the weighted base regressor plus penalties for limits, on a coarse grid.

    κ_p = ‖σ‖_2p ‖1/σ‖_2p of the singular values σ tends to the condition number as p grows and,
    unlike it, is smooth where singular values coincide, which is where an optimum lies. A limit
    that is passed by a share e costs `weight` · e² at each point of the grid.
    """

    model: InverseModel
    limits: MotionLimits
    frames: MovingFrames
    shapes: FloatArray  # (3, n_samples, size): of a Fourier basis on the grid
    row_weights: FloatArray  # (n_joints,)
    start: FloatArray | None  # (n_joints,) or None: posture at rest; None: it is chosen too
    power: float  # p
    weight: float
    # What is minimised: log κ_p, or the mean of log 1/σ, of which the determinant of the covariance
    # is a function (D-optimality)
    criterion: Criterion = "condition"

    def unpack(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Start posture (n_joints,) and coefficients (size, n_joints) of a design vector."""
        joints, scale = len(self.limits.lower), self.limits.half_range
        coefficients = x[joints:].reshape(-1, joints) * scale
        if self.start is not None:
            return self.start, coefficients
        return self.limits.middle + x[:joints] * scale, coefficients

    def __call__(self, x: FloatArray) -> tuple[float, FloatArray]:
        """Cost and gradient of a design vector (n_joints · (1 + size),).

        Raises DataError: they are no finite numbers.
        """
        limits, (start, coefficients) = self.limits, self.unpack(x)
        states = self.shapes @ coefficients
        states[0] += start
        q = states[0].copy()
        regressor, slopes = self._regressors(states)
        value, by_entry = self._criterion(regressor)
        if limits.torque_checked:
            cost, by_torque = self._penalty(regressor @ self.model.given, limits.torque)
            value += cost
            by_entry += by_torque[:, :, None] * self.model.given
        by_state = np.einsum("sjc,ksjc->ks", by_entry, slopes, optimize=True)
        by_state = by_state.reshape(3, len(start), len(q)).transpose(0, 2, 1)
        states[0] -= limits.middle
        box = np.stack([limits.half_range, limits.velocity, limits.acceleration])
        of_box, by_box = self._penalty(states, box[:, None])
        of_floor, by_height = self._floor_penalty(q)
        value += of_box
        value += of_floor
        by_state = by_state + by_box
        by_state[0] += by_height
        scale = limits.half_range
        gradient = sum(s.T @ g for s, g in zip(self.shapes, by_state, strict=True)) * scale
        by_start = np.zeros(len(start)) if self.start is not None else by_state[0].sum(0) * scale
        slope = np.concatenate([by_start, np.ravel(gradient)])
        if not (np.isfinite(value) and np.all(np.isfinite(slope))):
            raise DataError(
                "the torques of the nominal model are beyond every number: look at the inertials, "
                "axes and limits of the URDF"
            )
        return value, slope

    def _regressors(self, states: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Base regressor (n_samples, n_joints, b), and its derivatives by q, dq and ddq."""
        _, samples, joints = states.shape
        states = np.tile(states, (1, 1 + 3 * joints, 1))
        states = states.reshape(3, 1 + 3 * joints, samples, joints)
        # The regressor is linear in the acceleration: a large step is exact.
        steps = (_STEP, _STEP, 1.0)
        for signal in range(3):
            for joint in range(joints):
                states[signal, 1 + signal * joints + joint, :, joint] += steps[signal]
        q, dq, ddq = states.reshape(3, -1, joints)
        matrices = self.model.matrix(q, dq, ddq, _SMOOTH * self.limits.velocity)
        matrices = matrices.reshape(1 + 3 * joints, samples, joints, -1)
        slopes = matrices[1:] - matrices[0]
        slopes /= np.repeat(steps, joints)[:, None, None, None]
        return matrices[0], slopes

    def _criterion(self, regressor: FloatArray) -> tuple[float, FloatArray]:
        """Log κ_p or mean log 1/σ, and its derivative by each entry of the unweighted regressor."""
        rows = regressor * self.row_weights[:, None]
        stacked = rows.reshape(-1, rows.shape[2])
        _, sigma, right = np.linalg.svd(np.linalg.qr(stacked, mode="r"))
        sigma = np.maximum(sigma, 1e-12 * sigma[0])
        if self.criterion == "precision":
            value = 0.5 * np.log(len(regressor)) - float(np.mean(np.log(sigma)))
            by_sigma = -1.0 / (len(sigma) * sigma)
        else:
            large = (sigma / sigma[0]) ** (2 * self.power)
            small = (sigma[-1] / sigma) ** (2 * self.power)
            value = np.log(sigma[0] / sigma[-1])
            value += (np.log(large.sum()) + np.log(small.sum())) / (2 * self.power)
            by_sigma = (large / large.sum() - small / small.sum()) / sigma
        # U = W V / σ
        left = stacked @ right.T / sigma
        by_entry = ((left * by_sigma) @ right).reshape(rows.shape)
        return float(value), by_entry * self.row_weights[:, None]

    def _penalty(self, values: FloatArray, limit: FloatArray) -> tuple[float, FloatArray]:
        """Penalty for values beyond their limit, and its derivatives by the values."""
        allowed = self.limits.margin * limit
        excess = np.maximum(np.abs(values) / allowed - 1.0, 0.0)
        slope = 2.0 * self.weight * excess * np.sign(values) / allowed
        return float(self.weight * np.sum(excess**2)), slope

    def _floor_penalty(self, q: FloatArray) -> tuple[float, FloatArray]:
        """Each 0.1 m below the floor counts as a limit passed by a share of 1."""
        if self.limits.floor is None:
            return 0.0, np.zeros_like(q)
        joints = q.shape[1]
        moved = np.concatenate([q, *(q + step for step in _STEP * np.eye(joints))])
        height, *others = np.split(self.frames.heights(moved), 1 + joints)
        excess = np.maximum(self.limits.floor - height, 0.0) / 0.1
        by_height = -2.0 * self.weight * excess / 0.1
        slopes = [np.sum(by_height * (other - height), axis=1) / _STEP for other in others]
        return float(self.weight * np.sum(excess**2)), np.column_stack(slopes)


_BLOCK = 2000

# A parameter counts as badly excited above this relative standard deviation, or below this share
# of its column that no combination of the other columns explains.
BAD_DEVIATION = 0.10
BAD_SHARE = 0.10


@dataclass(frozen=True)
class ConditionNumbers:
    """Ratio of the largest to the smallest singular value of the base regressor of a motion."""

    plain: float  # Rows and columns as they are (SI units): what publications state
    weighted: float  # Rows of joint j divided by its torque limit: what the design minimises
    # Weighted rows, and every column divided by its norm: free of the choice of units
    equilibrated: float
    # Geometric mean of the standard deviations along the principal directions, for one sample and a
    # torque noise of the torque limit (SI units): smaller is better. Unlike a condition number it
    # differs between a fast motion and a slow one.
    deviation: float


def weighted_r_factor(model: InverseModel, motion: Trajectory, weights: FloatArray) -> FloatArray:
    """R factor (b, b) of the base regressor with the rows of joint j times weights[j].

    RᵀR = XᵀΩX over all samples of the motion, Ω = diag(weights²).
    """

    def blocks() -> Iterator[FloatArray]:
        for start in range(0, len(motion.position), _BLOCK):
            block = slice(start, start + _BLOCK)
            matrix = model.matrix(*(signal[block] for signal in motion.signals))
            yield (matrix * weights[:, None]).reshape(-1, matrix.shape[2])

    return streamed_r_factor(blocks(), len(model.base.columns))


def condition_numbers(
    model: InverseModel, motion: Trajectory, torque_limit: FloatArray
) -> ConditionNumbers:
    """Condition numbers of the base regressor over all samples of a motion.

    - `torque_limit`: (n_joints,) N m (N)
    """
    weighted = weighted_r_factor(model, motion, 1.0 / torque_limit)
    norms = np.linalg.norm(weighted, axis=0)
    equilibrated = weighted / np.where(norms > 0.0, norms, 1.0)
    plain = weighted_r_factor(model, motion, np.ones(len(torque_limit)))
    sigma = np.maximum(np.linalg.svd(weighted, compute_uv=False), np.finfo(float).tiny)
    deviation = np.sqrt(len(motion.position)) * np.exp(-np.mean(np.log(sigma)))
    return ConditionNumbers(
        plain=float(np.linalg.cond(plain)),
        weighted=float(np.linalg.cond(weighted)),
        equilibrated=float(np.linalg.cond(equilibrated)),
        deviation=float(deviation),
    )


@dataclass(frozen=True)
class PredictedParameter:
    """What a designed motion will show of a base parameter."""

    name: str
    unit: str
    given: float  # Value of the nominal model
    std: float  # Predicted standard deviation
    # Share of the length of its weighted column that the others do not explain, 0 to 1
    unexplained: float

    @property
    def relative_std(self) -> float | None:
        """Std over the given value; None where that is zero."""
        return None if self.given == 0.0 else self.std / abs(self.given)

    @property
    def bad(self) -> bool:
        """Whether the motion shows this parameter badly."""
        relative = self.relative_std
        return self.unexplained < BAD_SHARE or (relative is not None and relative > BAD_DEVIATION)


def predict_parameters(
    model: InverseModel,
    period: Trajectory,
    repeats: int,
    torque_limit: FloatArray,
    torque_noise: float,
) -> tuple[PredictedParameter, ...]:
    """Predict the standard deviations of all base parameters, the worst first.

    Least squares under white torque noise of standard deviation `torque_noise` · limit at every
    sample: cov = (XᵀΩX)⁻¹ / repeats, Ω = diag(1 / σ_j²). Real errors of the model are larger.

    - `torque_limit`: (n_joints,) N m (N)
    - `torque_noise`: share of the torque limit
    """
    upper = weighted_r_factor(model, period, 1.0 / (torque_noise * torque_limit)) * np.sqrt(repeats)
    norms = np.linalg.norm(upper, axis=0)
    # Of the equilibrated factor: columns of unit length.
    spread = np.linalg.norm(np.linalg.pinv(upper / np.where(norms > 0.0, norms, 1.0)), axis=1)
    parameters = [
        PredictedParameter(name, unit, float(given), float(s / norm), float(1.0 / s))
        for name, unit, given, s, norm in zip(
            model.base.names, model.base.units, model.given, spread, norms, strict=True
        )
    ]
    # Relative deviations from the largest; then, without a given value, the least shown.
    compared = [parameter for parameter in parameters if parameter.given != 0.0]
    others = [parameter for parameter in parameters if parameter.given == 0.0]
    compared.sort(key=lambda parameter: -parameter.std / abs(parameter.given))
    return (*compared, *sorted(others, key=lambda parameter: parameter.unexplained))


SAMPLES_PER_HARMONIC = 16
_MOST_HARMONICS = 100  # the search has two coefficients for each, at every joint

# p of the criterion, weight of the penalties, iterations: from smooth and lenient to sharp.
_FIRST = (1.0, 10.0, 40)
_LATER = ((2.0, 10.0, 60), (4.0, 30.0, 80), (16.0, 100.0, 120), (16.0, 1000.0, 60))
_RANDOM_STARTS = 5
_KEPT = 2
_POINTS = 100


@dataclass(frozen=True)
class DesignSettings:
    """What is asked of a motion for identification."""

    period: float = 10.0  # s; a whole number of samples
    repeats: int = 3  # Periods, one after the other
    rate: float = 1000.0  # Samples per second
    harmonics: int = 5  # Of 1 / period
    seed: int = 1  # Of the random starts
    time_limit: float = 120.0  # s, after which the best so far is taken
    # (n_joints,) or None: posture at rest in rad (m); None: chosen by the design
    start: FloatArray | None = None
    criterion: Criterion = "condition"  # Least condition number, or least standard deviations


@dataclass(frozen=True)
class Design:
    """A motion within all limits, and how good it is."""

    trajectory: Trajectory  # All repeats with the sample at the end
    period: Trajectory  # One of them without it
    before: ConditionNumbers  # Medians over random Fourier motions, scaled to the same limits
    after: ConditionNumbers  # Of this motion
    use: LimitUse  # Over every sample
    # Whether the time limit ended the search: another machine may then find another motion
    ended_early: bool
    seconds: float


def design_excitation(
    model: InverseModel,
    limits: MotionLimits,
    settings: DesignSettings,
    progress: Progress | None = None,
) -> Design:
    """Find the motion with the least condition number of the weighted base regressor.

    (Or with the least mean deviation: `DesignSettings.criterion`.) Minimises log κ_p, or the mean
    of log 1/σ (see `ExcitationCost`), by L-BFGS from random starts, sharpening p from 1
    to 16. The work is bounded by iterations: the same seed gives the same motion unless the time
    limit ends it early. The result is scaled until every sample keeps every limit.

    Raises UsageError: settings outside their range, a start posture outside its limits, a floor
    that no posture keeps above. DataError: no motion within the limits was found.
    """
    began = time.monotonic()
    FourierBasis(settings.period, settings.harmonics)
    if not 1 <= settings.repeats <= MOST_SAMPLES:
        raise UsageError(f"repeats {settings.repeats}: 1 to {MOST_SAMPLES} are possible")
    if settings.harmonics > _MOST_HARMONICS:
        raise UsageError(f"harmonics {settings.harmonics}: at most {_MOST_HARMONICS} are possible")
    require_sampling(settings.rate, settings.period * settings.repeats, "the motion")
    if not 0.0 < settings.time_limit < np.inf:
        raise UsageError(f"time limit {settings.time_limit:g}: a finite number above 0 is needed")
    samples = settings.period * settings.rate
    if abs(samples - round(samples)) > 1e-6 * samples:
        raise UsageError(
            f"a period of {settings.period:g} s at {settings.rate:g} per second is no whole "
            "number of samples; change the one or the other"
        )
    if samples < SAMPLES_PER_HARMONIC * settings.harmonics:
        raise UsageError(
            f"{settings.rate:g} samples per second: {settings.harmonics} harmonics of "
            f"{settings.period:g} s need {SAMPLES_PER_HARMONIC * settings.harmonics} a period"
        )
    if settings.start is not None:
        require_inside(settings.start, limits, model.robot.joints)
    report = progress or (lambda stage, share: None)
    search = _Search(model, limits, settings, report, began + settings.time_limit)
    # The matrices are small: threads of the linear algebra would cost more than they bring.
    with one_thread():
        random = np.random.default_rng(settings.seed)
        starts = [search.random_start(random) for _ in range(_RANDOM_STARTS)]
        before = list(filter(None, map(search.feasible, starts)))
        first = [search.improved(x, (_FIRST,)) for x in starts]
        first.sort(key=lambda x: replace(search.cost, power=_FIRST[0], weight=_FIRST[1])(x)[0])
        later = [search.improved(x, _LATER) for x in first[:_KEPT]]
        report("checking every sample", 1.0)
        designed = list(filter(None, map(search.feasible, later)))
        # An unfinished search may have left the limits: those of earlier stages are taken.
        designed = designed or list(filter(None, map(search.feasible, (*first, *starts))))
    if not designed:
        raise DataError(
            "no motion within the limits was found: try another --seed, a larger --margin, "
            "a longer --period or a lower --floor"
        )
    figure = "weighted" if settings.criterion == "condition" else "deviation"
    best, numbers = min(designed, key=lambda pair: float(getattr(pair[1], figure)))
    repeated = (np.vstack([part] * settings.repeats + [part[:1]]) for part in best.signals)
    trajectory = Trajectory(best.joints, best.rate, *repeated)
    of_random = [astuple(numbers) for _, numbers in before or designed[:1]]
    return Design(
        trajectory=trajectory,
        period=best,
        before=ConditionNumbers(*np.median(of_random, axis=0).tolist()),
        after=numbers,
        use=use_within(model.robot, limits, trajectory),
        ended_early=search.ended_early,
        seconds=time.monotonic() - began,
    )


class _Search:
    """Random starts, their improvement until a deadline, and the scaling to the limits."""

    def __init__(
        self,
        model: InverseModel,
        limits: MotionLimits,
        settings: DesignSettings,
        progress: Progress,
        deadline: float,
    ) -> None:
        self.basis = FourierBasis(settings.period, settings.harmonics)
        frames = moving_frames(model.robot)
        require_reachable(frames, limits)
        self.model, self.limits, self.settings = model, limits, settings
        self.progress, self.deadline = progress, deadline
        self.ended_early = False
        points = max(_POINTS, SAMPLES_PER_HARMONIC * settings.harmonics)
        self.cost = ExcitationCost(
            model=model,
            limits=limits.narrowed(),
            frames=frames,
            shapes=self.basis.shapes(np.arange(points) * settings.period / points),
            row_weights=1.0 / limits.torque,
            start=settings.start,
            power=1.0,
            weight=1.0,
            criterion=settings.criterion,
        )
        self.planned = _RANDOM_STARTS * _FIRST[2] + _KEPT * sum(step[2] for step in _LATER)
        self.done = 0

    def random_start(self, random: np.random.Generator) -> FloatArray:
        """Gaussian coefficients, scaled joint by joint to the position and velocity limits."""
        limits, joints = self.limits, len(self.limits.lower)
        start = random.uniform(-0.3, 0.3, joints) * limits.margin
        coefficients = random.normal(size=(self.basis.size, joints))
        x = np.concatenate([start, coefficients.ravel()])
        posture, coefficients = self.cost.unpack(x)
        position, velocity, _ = self.cost.shapes @ coefficients
        allowed = np.stack([limits.room(posture), limits.margin * limits.velocity])
        scale = (allowed / np.abs([position, velocity]).max(axis=1)).min(axis=0)
        x[joints:] = (coefficients * scale / limits.half_range).ravel()
        return x

    def improved(self, x: FloatArray, steps: tuple[tuple[float, float, int], ...]) -> FloatArray:
        """Minimise the cost with the power, weight and iterations of one step after another."""
        for power, weight, iterations in steps:
            if time.monotonic() > self.deadline:
                self.ended_early = True
                return x
            cost = replace(self.cost, power=power, weight=weight)
            before = self.done

            def watch(intermediate_result: object) -> None:
                self.done += 1
                self.progress("searching", min(self.done / self.planned, 1.0))
                if time.monotonic() > self.deadline:
                    self.ended_early = True
                    raise StopIteration

            options = {"maxiter": iterations, "maxcor": 30}
            x = scipy.optimize.minimize(
                cost, x, jac=True, method="L-BFGS-B", callback=watch, options=options
            ).x
            self.done = before + iterations
        return np.asarray(x)

    def feasible(self, x: FloatArray) -> tuple[Trajectory, ConditionNumbers] | None:
        """Scale a motion about its start posture until every sample keeps every limit."""
        rate, robot = self.settings.rate, self.model.robot
        start, coefficients = self.cost.unpack(x)
        shapes = self.basis.shapes(np.arange(round(self.settings.period * rate)) / rate)
        low, high, trial, motion = 0.0, 1.0, 1.0, None
        for _ in range(12):
            position, velocity, acceleration = trial * (shapes @ coefficients)
            candidate = Trajectory(robot.joints, rate, position + start, velocity, acceleration)
            if limit_use(robot, self.limits, candidate).within(self.limits):
                low, motion = trial, candidate
                if trial == 1.0:
                    break
            else:
                high = trial
            trial = 0.5 * (low + high) if low > 0.0 or high < 0.9 else high - 0.01
        if motion is None:
            return None
        return motion, condition_numbers(self.model, motion, self.limits.torque)
