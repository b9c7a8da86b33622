"""A diagnosis with a contrast that was made up, for the page and the tables."""

from dataclasses import replace

from idim_iv_ros.diagnosis.result import (
    ContrastCause,
    ContrastResult,
    EffectParameter,
    Evidence,
    GapResult,
    Indistinguishable,
    JointContrast,
    JointTorque,
)
from tests.report.sample_gap import sample_gap


def sample_contrast() -> GapResult:
    """A load that the second set has."""
    result = sample_gap(2, "both")
    sentence = "What changed from the reference recordings to b1, b2: a payload of 0.81 kg."
    cause = ContrastCause(
        effect="payload",
        kind="parametric",
        joint="joint_2",
        change="changed",
        bags=("b1", "b2"),
        parameters={"mass": EffectParameter(0.81, 0.0102, "kg")},
        evidence=Evidence(900.0, chosen_in_folds="4 of 4"),
        indistinguishable_from=(Indistinguishable("link_inertia", "joint_2", 0.99),),
        torques=(JointTorque("joint_2", 1.2, 0.31), JointTorque("joint_1", 3.4, 0.2)),
        sentence="payload of joint_2 changed: mass 0.81 ± 0.02 kg",
    )
    contrast = ContrastResult(
        reference=("a",),
        against=("b1", "b2"),
        differs=True,
        sentence=sentence,
        joints=(
            JointContrast("joint_1", 3.4, 0.13, 0.13, 0.2, 0.0),
            JointContrast("joint_2", 1.2, 0.04, 0.04, 0.31, 0.0),
        ),
        causes=(cause,),
        common=("stribeck at joint_1",),
        notes=("the effort acts 0.5 ms after its stamp",),
    )
    return replace(result, contrast=contrast, summary=f"{sentence} By itself: {result.summary}")
