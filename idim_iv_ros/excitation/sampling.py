"""How finely and for how long a motion may be sampled."""

import math

from idim_iv_ros.errors import UsageError

# More than an hour of 1000 per second; each signal of each joint is an array of so many.
MOST_SAMPLES = 4_000_000
_SLOWEST, _FASTEST = 1.0, 1e5  # samples per second


def require_sampling(rate: float, duration: float, what: str) -> None:
    """Refuse a rate that no controller has, and more samples than can be computed.

    Parameters
    ----------
    rate
        Samples per second.
    duration
        s.
    what
        What has them, for the message: ``the trajectory``.

    Raises
    ------
    UsageError
        The rate or the number of samples is out of its range.
    """
    if not _SLOWEST <= rate <= _FASTEST:
        raise UsageError(
            f"{what} has {rate:.4g} samples per second: {_SLOWEST:g} to {_FASTEST:g} are possible"
        )
    if not 0.0 < duration < math.inf:
        raise UsageError(f"{what} lasts {duration:g} s: a positive number of seconds is needed")
    if rate * duration > MOST_SAMPLES:
        raise UsageError(
            f"{what} lasts {duration:.4g} s: at {rate:.4g} samples per second at most "
            f"{MOST_SAMPLES / rate:.4g} s are possible"
        )
