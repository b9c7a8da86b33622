"""Design of a periodic motion that identifies all base parameters well."""

import time
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.compilation import one_thread
from idim_iv_ros.errors import DataError
from idim_iv_ros.excitation.criterion import ConditionNumbers
from idim_iv_ros.excitation.limit_use import LimitUse, limit_use, moving_frames
from idim_iv_ros.excitation.limits import MotionLimits
from idim_iv_ros.excitation.search import DesignSettings, Search, require_possible
from idim_iv_ros.excitation.trajectory import Trajectory
from idim_iv_ros.model import InverseModel
from idim_iv_ros.progress import Progress


@dataclass(frozen=True)
class Design:
    """A motion within all limits, and how good it is.

    Attributes
    ----------
    trajectory, period : Trajectory
        All repeats with the sample at the end; one period without it.
    before : ConditionNumbers
        Medians over random Fourier motions, scaled to the same limits.
    after : ConditionNumbers
        Of this motion.
    use : LimitUse
        Over every sample.
    ended_early : bool
        Whether the time limit ended the search: another machine may then find another motion.
    seconds : float
    """

    trajectory: Trajectory
    period: Trajectory
    before: ConditionNumbers
    after: ConditionNumbers
    use: LimitUse
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

    Raises
    ------
    UsageError
        Settings outside their range, a start posture outside its limits, a floor that no posture
        keeps above.
    DataError
        No motion within the limits was found.
    """
    began = time.monotonic()
    require_possible(settings, limits, model.robot.joints)
    frames = moving_frames(model.robot)
    report = progress or (lambda stage, share: None)
    search = Search(model, limits, frames, settings, report)
    # The matrices are small: threads of the linear algebra would cost more than they bring.
    with one_thread():
        random, found = search.run(began + settings.time_limit)
    judged = "weighted" if settings.criterion == "condition" else "deviation"
    best, numbers = min(found, key=lambda pair: float(getattr(pair[1], judged)))
    periods = np.vstack([best.position] * settings.repeats + [best.position[:1]])
    rates = np.vstack([best.velocity] * settings.repeats + [best.velocity[:1]])
    accelerations = np.vstack([best.acceleration] * settings.repeats + [best.acceleration[:1]])
    trajectory = Trajectory(best.joints, best.rate, periods, rates, accelerations)
    use = limit_use(model.robot, limits, frames, trajectory)
    if not use.within(limits):
        raise DataError("no motion within the limits was found: a limit broke at full rate")
    return Design(
        trajectory=trajectory,
        period=best,
        before=_median(random),
        after=numbers,
        use=use,
        ended_early=search.ended_early,
        seconds=time.monotonic() - began,
    )


def _median(numbers: list[ConditionNumbers]) -> ConditionNumbers:
    return ConditionNumbers(
        *(
            float(np.median([getattr(number, name) for number in numbers]))
            for name in ("plain", "weighted", "equilibrated", "deviation")
        )
    )
