"""Estimates beside the true parameters of a simulated robot."""

from scipy.stats import binom

from idim_iv_interfaces.msg import ParameterEstimates

_OUTSIDE = 0.0027  # probability of more than 3 σ
_LEVEL = 1e-3


def require_truth(estimates: ParameterEstimates, truth: dict[str, float]) -> None:
    """All parameters within 3 σ, but for as many as chance explains at a level of 0.001."""
    off = {p.name: (p.value - truth[p.name]) / p.std for p in estimates.estimates}
    assert set(off) == set(truth)
    outside = {name: deviation for name, deviation in off.items() if abs(deviation) > 3.0}
    assert len(outside) <= binom.isf(_LEVEL, len(truth), _OUTSIDE), outside
