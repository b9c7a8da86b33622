"""A diagnosis with every part that gap.json can hold, for the page and the messages."""

from dataclasses import replace
from pathlib import Path

from idim_iv_ros.diagnosis.result import EffectParameter, GapResult, Transmission
from tests.report.sample_contrast import sample_contrast
from tests.report.sample_gap import sample_gap
from tests.simulator_files.cases import case


def sample_everything(folder: Path) -> GapResult:
    """Contrast, hints, a transmission and physical parameters."""
    transmission = Transmission(
        joint="joint_1",
        stiffness=EffectParameter(8123.4, 41.2, "N m/rad"),
        stiffness_at_least=8042.0,
        damping=None,
        backlash=None,
        backlash_at_most=2.1e-4,
        lost_motion=None,
        time_offset=EffectParameter(4.1e-4, 2e-5, "s"),
        position_error=True,
    )
    return replace(
        sample_contrast(),
        hints=sample_gap(2, "none").hints,
        transmissions=(transmission,),
        physical=case(folder, "arm2").gap.physical,
    )
