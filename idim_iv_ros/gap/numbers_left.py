"""Given numbers that are wrong, though no cause tells which."""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.gap.baseline import Baseline
from idim_iv_ros.gap.joint_units import unit_at
from idim_iv_ros.gap.parametric import ParametricOutcome
from idim_iv_ros.gap.result import Stage

# Times the gap of the refit that the named causes leave, and share of the torque that they leave
# more than the refit, above which it is said.
_TIMES_REFIT, _SHARE = 2.0, 0.05


def numbers_left(data: Baseline, outcome: ParametricOutcome, stages: Sequence[Stage]) -> str:
    """Say what new numbers take of the gap beside the causes that were found; empty if little.

    Parameters
    ----------
    outcome
        Its `after` is the gap with all causes.
    stages
        Of these the refit.
    """
    refit = next(stage for stage in stages if stage.name == "refit")
    worst = (0.0, "")
    for joint, name in enumerate(data.joints):
        after, least = float(outcome.after[joint]), refit.torque_rms[name]
        size = max(float(np.sqrt(np.mean(data.rows[joint].torque ** 2))), 1e-300)
        share = (after - least) / size
        if after > _TIMES_REFIT * least and share > max(_SHARE, worst[0]):
            unit = unit_at(data, joint, "N m")
            worst = (share, f"from {after:.3g} to {least:.3g} {unit} at {name}")
    if not worst[1]:
        return ""
    subject = "Other given numbers are wrong, too" if outcome.causes else "Given numbers are wrong"
    return f"{subject}: new ones take the gap {worst[1]}, but which they are cannot be told."
