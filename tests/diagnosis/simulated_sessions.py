"""Sessions of the two-joint arm that many tests start from: made once in a process."""

from dataclasses import replace
from functools import cache
from typing import Any

from bags.simulated_arms import arm2
from idim_iv_ros.diagnosis.refit.baseline import Baseline, baseline
from tests.estimation.test_simulated_arms import recorded


@cache
def arm2_session(seconds: float) -> Baseline:
    """One recording, refitted; what the arm really is differs from its configuration."""
    arm = arm2(seconds=seconds)
    return baseline([recorded(arm, 1)], arm.configuration)


def with_signals(data: Baseline, **changes: Any) -> Baseline:
    """The same session of one recording with other signals."""
    (motion,) = data.prepared.motions
    changed = replace(motion, signals=replace(motion.signals, **changes))
    return replace(data, prepared=replace(data.prepared, motions=(changed,)))
