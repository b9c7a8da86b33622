"""What is asked of a motion for identification, and whether it can be."""

from dataclasses import dataclass

import numpy as np

from idim_iv_ros.errors import UsageError
from idim_iv_ros.excitation.cost import Criterion
from idim_iv_ros.excitation.fourier import FourierBasis
from idim_iv_ros.excitation.limits import MotionLimits
from idim_iv_ros.excitation.sampling import MOST_SAMPLES, require_sampling
from idim_iv_ros.excitation.start_posture import require_inside
from idim_iv_ros.types import FloatArray

SAMPLES_PER_HARMONIC = 16
_MOST_HARMONICS = 100  # the search has two coefficients for each, at every joint


@dataclass(frozen=True)
class DesignSettings:
    """What is asked for.

    Attributes
    ----------
    period : float
        s; a whole number of samples.
    repeats : int
        Periods, one after the other.
    rate : float
        Samples per second.
    harmonics : int
        Of 1 / period.
    seed : int
        Of the random starts.
    time_limit : float
        s, after which the best so far is taken.
    start : (n_joints,) or None
        Posture at rest in rad (m); None: chosen by the design.
    criterion : "condition" or "precision"
        Least condition number, or least standard deviations.
    """

    period: float = 10.0
    repeats: int = 3
    rate: float = 1000.0
    harmonics: int = 5
    seed: int = 1
    time_limit: float = 120.0
    start: FloatArray | None = None
    criterion: Criterion = "condition"


def require_possible(
    settings: DesignSettings, limits: MotionLimits, joints: tuple[str, ...]
) -> None:
    """Refuse settings outside their range.

    Raises
    ------
    UsageError
        One line that names the setting.
    """
    FourierBasis(settings.period, settings.harmonics)
    if settings.repeats < 1:
        raise UsageError(f"repeats {settings.repeats}: at least 1 is needed")
    if settings.repeats > MOST_SAMPLES:
        raise UsageError(
            f"the motion has more than {MOST_SAMPLES} repeats: no more samples are possible"
        )
    if not (np.isfinite(settings.rate) and settings.rate > 0.0):
        raise UsageError(f"rate {settings.rate:g}: samples per second above 0 are needed")
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
