"""Joints at which most of the gap stays: neither noise nor anything that was found."""

from collections.abc import Sequence

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.joint_units import unit_at
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.noise_floor import NoiseFloor
from idim_iv_ros.diagnosis.result import Stage


def unexplained_joints(
    data: Baseline, stages: Sequence[Stage], floors: Sequence[NoiseFloor]
) -> str:
    """Say in one sentence what the last model still misses, the worst first; empty if nothing."""
    first, last = stages[0], stages[-1]
    worst = []
    for joint, (name, floor) in enumerate(zip(data.joints, floors, strict=True)):
        rest = last.torque_rms[name]
        share = rest / data.torque_sizes[joint]
        much = (
            share > settings.UNEXPLAINED_OF_TORQUE
            or rest > settings.UNEXPLAINED_OF_GAP * first.torque_rms[name]
        )
        if (
            floor.sigma is not None
            and rest > settings.UNEXPLAINED_OVER_NOISE * floor.sigma
            and much
        ):
            unit = unit_at(data, joint, "N m")
            words = f"{rest:.3g} {unit} at {name} ({100 * share:.0f} % of its torque"
            worst.append((share, f"{words}, noise {floor.sigma:.2g} {unit})"))
    if not worst:
        return ""
    listed = ", ".join(words for _, words in sorted(worst, reverse=True))
    return f"Still unexplained: {listed}; do not take the causes for the whole gap there."
