"""Dry friction of each joint: the scale of what is a plausible size of an effect."""

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.structural.candidate_rows import operating_range


def dry_friction(data: Baseline) -> tuple[float, ...]:
    """Dry friction of each joint from the refit, N m (N); 5 % of the peak where it has none."""
    covered = operating_range(data)
    levels = data.prepared.model.dynamic_parameters(data.estimate.linear.values).coulomb
    return tuple(
        float(level)
        if level > settings.LEAST_DRY_FRICTION * peak
        else settings.ASSUMED_DRY_FRICTION * float(peak)
        for level, peak in zip(levels, covered.torque, strict=True)
    )
