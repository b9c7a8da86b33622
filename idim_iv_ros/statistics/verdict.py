"""The paper's verdict in words: may the estimates of a joint be believed (section IV.C)?"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from idim_iv_ros.statistics.hypothesis import HypothesisTest
from idim_iv_ros.statistics.residuals import ResidualDiagnosis

Verdict = Literal["valid", "autocorrelated", "misspecified", "inconclusive"]

# Share of a joint's torque below which what the tests reject for is said as a note: no simulator is
# wrong because of it. It counts where the residual itself, less the noise of the sensors, is below
# it too: a stiff loop holds the simulated motion to the measured one whatever the model is.
SMALL_TORQUE_PERCENT = 1.0
# What the filters smear around a reversal, where a joint sticks, reaches 1.4 % of the torque on a
# simulated arm whose model is right; what the residual holds of the motion is judged from this on.
LEAST_LEFT_PERCENT = 2.0


@dataclass(frozen=True)
class JointVerdict:
    """The verdict on one joint and a sentence that an engineer can act on.

    `torque_percent`: the residual less the noise of the sensors, in percent of the joint's torque;
    None where it is unknown. `rejected_percent`: the largest deviation that a test rejects for,
    likewise. `note`: what was rejected and is too small for a verdict. `rejected`: whether the
    instruments are, by however little.
    """

    joint: str
    verdict: Verdict
    sentence: str
    note: str = ""
    torque_percent: float | None = None
    rejected_percent: float = 0.0
    rejected: bool = False


@dataclass(frozen=True)
class OverallVerdict:
    """The verdict on the whole identification, the least favourable of its joints."""

    verdict: Verdict
    sentence: str


def judge_joint(
    instruments: HypothesisTest,
    residual: ResidualDiagnosis,
    specification: Sequence[HypothesisTest] = (),
    noise: float | None = None,
) -> JointVerdict:
    """Join the instrument test, the residual and the specification tests of one joint.

    Where tests reject and both the deviation and the residual beyond the noise are below 1 % of
    the torque, that is a note.

    Parameters
    ----------
    instruments : HypothesisTest
        The Wald test of Π = I of this joint.
    residual : ResidualDiagnosis
        Of the same joint.
    specification : sequence of HypothesisTest
        Whether it follows the position, the speed or the acceleration. A rejection whose effect
        is below 2 % of the torque is not judged: reversals alone leave that much.
    noise : float, optional
        Standard deviation that the sensors' noise gives the torque, N m (N). Without it no
        deviation counts as small.
    """
    beyond = None  # residual less the noise of the sensors, in percent of the joint's torque
    if noise is not None and residual.relative_percent is not None and residual.rms > 0.0:
        share = 1.0 - min(noise / residual.rms, 1.0) ** 2
        beyond = float(residual.relative_percent * np.sqrt(share))
    tests = [test for test in (instruments, *specification) if test.accepted is False]
    return JointVerdict(
        residual.joint,
        *_judged(instruments, residual, specification, beyond),
        torque_percent=beyond,
        rejected_percent=max(map(_percent, tests), default=0.0),
        rejected=instruments.accepted is False,
    )


def _judged(
    instruments: HypothesisTest,
    residual: ResidualDiagnosis,
    specification: Sequence[HypothesisTest],
    beyond: float | None,
) -> tuple[Verdict, str, str]:
    """Verdict, sentence, and what was rejected and is too small for a verdict."""
    joint = residual.joint
    if instruments.accepted is None:
        sentence = (
            f"{joint}: the instruments were not tested ({instruments.reason}), so this recording "
            "does not show whether the model is right at this joint."
        )
        return "inconclusive", sentence, ""
    rejecting = [test for test in specification if test.accepted is False]
    left = [test for test in rejecting if _percent(test) >= LEAST_LEFT_PERCENT]
    deviation = instruments.torque_deviation_percent
    sizes = [size for size in (beyond, deviation) if size is not None]
    small = len(sizes) == 2 and max(sizes) < SMALL_TORQUE_PERCENT
    if not instruments.accepted and not small:
        sentence = _rejected(instruments, joint)
        if left:
            sentence += f" The residual follows {_families(left)}."
        return "misspecified", sentence, ""
    if left:
        sentence = (
            f"{joint}: the instruments are valid, but the residual follows {_families(left)}. The "
            "loop holds the motion whatever the model is; the torque says that an effect is "
            "missing here, and the estimates are biased by what it shares with the terms of the "
            "model."
        )
        return "misspecified", sentence, ""
    note = _small_deviations(instruments, rejecting)
    head = f"{joint}: {'the instruments are valid' if instruments.accepted else note}"
    more = f" Small beside the torque: {note}." if note and instruments.accepted else ""
    if residual.white is None:
        sentence = (
            f"{head}, but the autocorrelation of the residual was not tested "
            f"({residual.whiteness.reason}), so the standard deviations cannot be judged.{more}"
        )
        return "inconclusive", sentence, ""
    if residual.white:
        hold = ": the estimates and their standard deviations hold" if not note else ""
        sentence = f"{head}, and the residual may be treated as white{hold}.{more}"
        return "valid", sentence, note
    return "autocorrelated", _autocorrelated(residual, head) + more, note


def _percent(test: HypothesisTest) -> float:
    """Size of what a test rejects for, in percent of the torque; 0 where it is not known."""
    return test.torque_deviation_percent or 0.0


def _small_deviations(instruments: HypothesisTest, rejecting: Sequence[HypothesisTest]) -> str:
    """What tests reject for that is too small to matter, in words; empty where they reject none."""
    parts = []
    if instruments.accepted is False:
        parts.append(
            "simulated and measured motion differ by more than noise, by "
            f"{_percent(instruments):.2g} % of the torque"
        )
    if rejecting:
        parts.append(f"the residual follows {_families(rejecting)}")
    return " and ".join(parts)


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


def _families(left: Sequence[HypothesisTest]) -> str:
    """What the residual follows, the largest part first."""
    return _names(
        [
            f"the {test.scope.rpartition(': ')[2]} ({_percent(test):.2g} % "
            f"of the torque, p = {test.p_value:.2g})"
            for test in sorted(left, key=_percent, reverse=True)
        ]
    )


def _autocorrelated(residual: ResidualDiagnosis, head: str) -> str:
    times = residual.sigma_understatement
    head = f"{head}, the residual is autocorrelated, AR({residual.ar_order})"
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

    `joints`: one for each joint. `instruments`: the Wald test of Π = I over all rows, scope "all";
    it sees what no joint shows alone.
    """
    wrong, inconclusive, autocorrelated = (
        [joint.joint for joint in joints if joint.verdict == kind]
        for kind in ("misspecified", "inconclusive", "autocorrelated")
    )
    # Residual beyond the noise first, then the largest rejected deviation.
    largest = sorted(joints, key=lambda j: (-(j.torque_percent or 0.0), -j.rejected_percent))
    small = _small(largest)
    if wrong:
        wrong = [joint.joint for joint in largest if joint.verdict == "misspecified"]
        sentence = (
            f"The model is wrong at {_names(wrong)}: a physical effect is missing there, or the "
            "control law is another; the reason is given with each joint."
        )
        worst = largest[0]
        if worst.joint not in wrong and (worst.torque_percent or 0.0) >= SMALL_TORQUE_PERCENT:
            sentence += (
                f" The residual beyond the noise is largest at {worst.joint} "
                f"({worst.torque_percent:.2g} % of its torque): what is missing there moves other "
                "joints, too, so look there first."
            )
        if inconclusive:
            sentence += f" The tests are inconclusive at {_names(inconclusive)}."
        return OverallVerdict("misspecified", sentence + small)
    if _shared(joints, instruments):
        assert instruments is not None
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
        return OverallVerdict("inconclusive", sentence + small)
    head = "Errors are small." if small else "The instruments are valid."
    if autocorrelated:
        return OverallVerdict(
            "autocorrelated",
            f"{head} The residual is autocorrelated at "
            f"{'all joints' if len(autocorrelated) == len(joints) else _names(autocorrelated)}: "
            f"use the refined standard deviations.{small}",
        )
    rest = "" if small else " The estimates and their standard deviations hold."
    return OverallVerdict("valid", f"{head} The residuals are white.{rest}{small}")


def _shared(joints: Sequence[JointVerdict], instruments: HypothesisTest | None) -> bool:
    """Whether all rows reject the instruments, no joint alone does, and it is not too little."""
    if instruments is None or instruments.accepted is not False:
        return False
    sizes = [instruments.torque_deviation_percent, *(joint.torque_percent for joint in joints)]
    little = all(size is not None and size < SMALL_TORQUE_PERCENT for size in sizes)
    return not little and not any(joint.rejected for joint in joints)


def _small(largest: Sequence[JointVerdict]) -> str:
    """What was rejected and is too small for a verdict, the largest first; empty if nothing."""
    noted = [joint for joint in largest if joint.note]
    if not noted:
        return ""
    others = [other.joint for other in noted[1:]]
    where = f"at {noted[0].joint} {noted[0].note}"
    where += f", and less at {_names(others)}" if others else ""
    return (
        f" Small beside the torque: {where}. Single parameters may be off by more than their "
        "standard deviations."
    )


def _names(joints: Sequence[str]) -> str:
    if len(joints) == 1:
        return joints[0]
    return f"{', '.join(joints[:-1])} and {joints[-1]}"
