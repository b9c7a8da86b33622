"""Design of a periodic motion that identifies all base parameters well."""

import time
from dataclasses import astuple, dataclass, replace

import numpy as np
import scipy

from idim_iv_ros.compilation import one_thread
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.excitation.criterion import (
    ConditionNumbers,
    Criterion,
    ExcitationCost,
    condition_numbers,
)
from idim_iv_ros.excitation.fourier import FourierBasis
from idim_iv_ros.excitation.limits import (
    LimitUse,
    MotionLimits,
    limit_use,
    moving_frames,
    require_inside,
    require_reachable,
    use_within,
)
from idim_iv_ros.excitation.trajectory import MOST_SAMPLES, Trajectory, require_sampling
from idim_iv_ros.model import InverseModel
from idim_iv_ros.progress import Progress
from idim_iv_ros.types import FloatArray

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
    require_possible(settings, limits, model.robot.joints)
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


def require_possible(
    settings: DesignSettings, limits: MotionLimits, joints: tuple[str, ...]
) -> None:
    """Refuse settings outside their range.

    Raises UsageError: one line that names the setting.
    """
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
        require_inside(settings.start, limits, joints)


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
