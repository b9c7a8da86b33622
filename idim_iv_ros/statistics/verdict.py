"""The paper's verdict in words: may the estimates of a joint be believed (section IV.C)?"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from idim_iv_ros.statistics.hypothesis import HypothesisTest
from idim_iv_ros.statistics.residuals import ResidualDiagnosis

Verdict = Literal["valid", "autocorrelated", "misspecified", "inconclusive"]

SMALL_TORQUE_PERCENT = 1.0
# What the filters smear around a reversal, where a joint sticks, reaches 1.4 % of the torque on a
# simulated arm whose model is right; what the residual holds of the motion is judged from this on.
LEAST_LEFT_PERCENT = 2.0


@dataclass(frozen=True)
class JointVerdict:
    """The verdict on one joint and a sentence that an engineer can act on."""

    joint: str
    verdict: Verdict
    sentence: str


@dataclass(frozen=True)
class OverallVerdict:
    """The verdict on the whole identification, the least favourable of its joints."""

    verdict: Verdict
    sentence: str


def judge_joint(
    instruments: HypothesisTest,
    residual: ResidualDiagnosis,
    specification: Sequence[HypothesisTest] = (),
) -> JointVerdict:
    """Join the instrument test, the residual and the specification tests of one joint.

    Parameters
    ----------
    instruments : HypothesisTest
        The Wald test of Π = I of this joint.
    residual : ResidualDiagnosis
        Of the same joint.
    specification : sequence of HypothesisTest
        Whether it follows the position, the speed or the acceleration. A rejection whose effect
        is below 2 % of the torque is not judged: reversals alone leave that much.
    """
    joint = residual.joint
    if instruments.accepted is None:
        return JointVerdict(
            joint,
            "inconclusive",
            f"{joint}: the instruments were not tested ({instruments.reason}), so this recording "
            "does not show whether the model is right at this joint.",
        )
    left = [
        test
        for test in specification
        if test.accepted is False and (test.torque_deviation_percent or 0.0) >= LEAST_LEFT_PERCENT
    ]
    if not instruments.accepted:
        sentence = _rejected(instruments, joint)
        if left:
            sentence += f" The residual follows {_families(left)}."
        return JointVerdict(joint, "misspecified", sentence)
    if left:
        return JointVerdict(joint, "misspecified", _left(left, joint))
    if residual.white is None:
        reason = residual.whiteness.reason
        return JointVerdict(
            joint,
            "inconclusive",
            f"{joint}: the instruments are valid, but the autocorrelation of the residual was not "
            f"tested ({reason}), so the standard deviations cannot be judged.",
        )
    if residual.white:
        return JointVerdict(
            joint,
            "valid",
            f"{joint}: the instruments are valid and the residual may be treated as white: "
            "the estimates and their standard deviations hold.",
        )
    return JointVerdict(joint, "autocorrelated", _autocorrelated(residual))


def _rejected(instruments: HypothesisTest, joint: str) -> str:
    percent = instruments.torque_deviation_percent
    sentence = (
        f"{joint}: the instruments are rejected (p = {instruments.p_value:.2g}): the simulated "
        "motion differs from the measured one by more than noise"
    )
    if percent is None:
        return f"{sentence}. The model or the control law is wrong here."
    if percent < SMALL_TORQUE_PERCENT:
        # A pendulum without its gravity, 20 of 60 N m, moves the predicted torque by 0.4 %:
        # the loop holds the simulated motion to the reference whatever the model is.
        return (
            f"{sentence}, though only by {percent:.2g} % of the torque. A stiff loop hides most of "
            "a model error from this figure, so it does not say that the estimates are right: "
            "compare the estimates with another model of this joint to see how large the error is."
        )
    return (
        f"{sentence}, {percent:.2g} % of the torque. The model or the control law is wrong "
        "here and the estimates are biased: run idim-iv diagnose, which looks for the missing "
        "effect."
    )


def _left(left: Sequence[HypothesisTest], joint: str) -> str:
    """The instruments are valid, but the torque holds something of the motion."""
    return (
        f"{joint}: the instruments are valid, but the residual follows {_families(left)}. The loop "
        "holds the motion whatever the model is; the torque says that an effect is missing here, "
        "and the estimates are biased by what it shares with the terms of the model."
    )


def _families(left: Sequence[HypothesisTest]) -> str:
    """What the residual follows, the largest part first."""
    found = sorted(left, key=lambda test: -(test.torque_deviation_percent or 0.0))
    return _names(
        [
            f"the {test.scope.rpartition(': ')[2]} ({test.torque_deviation_percent or 0.0:.2g} % "
            f"of the torque, p = {test.p_value:.2g})"
            for test in found
        ]
    )


def _autocorrelated(residual: ResidualDiagnosis) -> str:
    times = residual.sigma_understatement
    order = residual.ar_order
    head = (
        f"{residual.joint}: the instruments are valid, the residual is autocorrelated, AR({order})"
    )
    if times >= 1.0:
        sentence = (
            f"{head}: the data are oversampled for the bandwidth of the loop. Use the refined "
            f"standard deviations; computed as if it were white they would be {times:.2g} times "
            "too small."
        )
    else:
        sentence = (
            f"{head}, as the decimation filter leaves it. Standard deviations computed as if it "
            f"were white are on the safe side, {1 / times:.2g} times too large; the refined ones "
            "are right."
        )
    if residual.whiteness_after.accepted is False:
        sentence += (
            " The filter does not whiten the residual fully (largest correlation that remains "
            f"{residual.largest_correlation_after:.2g}): decimate at a lower cut-off."
        )
    return sentence


def judge_all(
    joints: Sequence[JointVerdict], instruments: HypothesisTest | None = None
) -> OverallVerdict:
    """Join the verdicts on all joints with the instrument test of all rows.

    Parameters
    ----------
    joints : sequence of JointVerdict
        One for each joint.
    instruments : HypothesisTest, optional
        The Wald test of Π = I over all rows, scope "all"; it sees what no joint shows alone.
    """
    wrong, inconclusive, autocorrelated = (
        [each.joint for each in joints if each.verdict == kind]
        for kind in ("misspecified", "inconclusive", "autocorrelated")
    )
    if wrong:
        sentence = (
            f"The model is wrong at {_names(wrong)}: a physical effect is missing there, or the "
            "control law is another; the reason is given with each joint."
        )
        if len(wrong) + len(inconclusive) < len(joints):
            sentence += " Nothing speaks against the other joints."
        if inconclusive:
            sentence += f" The tests are inconclusive at {_names(inconclusive)}."
        return OverallVerdict("misspecified", sentence)
    if instruments is not None and instruments.accepted is False:
        return OverallVerdict(
            "misspecified",
            "No joint alone rejects its instruments, but all rows together do "
            f"(p = {instruments.p_value:.2g}): a small model error is shared by several joints, "
            "run idim-iv diagnose, which looks for it.",
        )
    if inconclusive:
        where = "any joint" if len(inconclusive) == len(joints) else _names(inconclusive)
        sentence = f"The estimates could not be tested at {where}"
        reason = None if instruments is None else instruments.reason
        sentence += f": {reason}." if reason else "; the reason is given with each joint."
        return OverallVerdict("inconclusive", sentence)
    if autocorrelated:
        return OverallVerdict(
            "autocorrelated",
            "The instruments are valid. The residual is autocorrelated at "
            f"{'all joints' if len(autocorrelated) == len(joints) else _names(autocorrelated)}: "
            "use the refined standard deviations.",
        )
    return OverallVerdict(
        "valid",
        "The instruments are valid and the residuals are white: the estimates and their "
        "standard deviations hold.",
    )


def _names(joints: Sequence[str]) -> str:
    if len(joints) == 1:
        return joints[0]
    return f"{', '.join(joints[:-1])} and {joints[-1]}"
