"""The paper's verdict in words: may the estimates of a joint be believed (section IV.C)?"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from idim_iv_ros.statistics.hypothesis import HypothesisTest
from idim_iv_ros.statistics.residuals import ResidualDiagnosis, beyond_noise

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

    - `specification`: whether it follows the position, the speed or the acceleration. A rejection
      whose effect is below 2 % of the torque is not judged: reversals alone leave that much.
    - `noise`: standard deviation that the sensors' noise gives the torque, N m (N). Without it no
      deviation counts as small.
    """
    beyond = None
    if noise is not None and residual.relative_percent is not None:
        beyond = beyond_noise(residual.relative_percent, residual.rms, noise)
    rejecting = [test for test in (instruments, *specification) if test.accepted is False]
    largest = max(map(_percent, rejecting), default=0.0)
    joint, rejected = residual.joint, instruments.accepted is False
    verdict, sentence, note = _verdict_of(instruments, residual, specification, beyond)
    return JointVerdict(joint, verdict, f"{joint}: {sentence}", note, beyond, largest, rejected)


def _verdict_of(
    instruments: HypothesisTest,
    residual: ResidualDiagnosis,
    specification: Sequence[HypothesisTest],
    beyond: float | None,
) -> tuple[Verdict, str, str]:
    """Verdict, sentence, and what was rejected and is too small for a verdict."""
    if instruments.accepted is None:
        sentence = (
            f"the instruments were not tested ({instruments.reason}), so this recording does not "
            "show whether the model is right at this joint."
        )
        return "inconclusive", sentence, ""
    rejecting = [test for test in specification if test.accepted is False]
    left = [test for test in rejecting if _percent(test) >= LEAST_LEFT_PERCENT]
    sizes = [beyond, instruments.torque_deviation_percent]
    small = all(size is not None and size < SMALL_TORQUE_PERCENT for size in sizes)
    if not instruments.accepted and not small:
        follows = f" The residual follows {_families(left)}." if left else ""
        return "misspecified", _rejected(instruments) + follows, ""
    if left:
        sentence = (
            f"the instruments are valid, but the residual follows {_families(left)}. The loop "
            "holds the motion whatever the model is; the torque says that an effect is missing "
            "here, and the estimates are biased by what it shares with the terms of the model."
        )
        return "misspecified", sentence, ""
    note = f"the residual follows {_families(rejecting)}" if rejecting else ""
    head, more = "the instruments are valid", f" Small beside the torque: {note}." if note else ""
    if not instruments.accepted:
        differ = "simulated and measured motion differ by more than noise, by"
        differ = f"{differ} {_percent(instruments):.2g} % of the torque"
        head = note = f"{differ} and {note}" if note else differ
        more = ""
    if residual.white is None:
        sentence = (
            f"{head}, but the autocorrelation of the residual was not tested "
            f"({residual.whiteness.reason}), so the standard deviations cannot be judged."
        )
        return "inconclusive", sentence + more, ""
    if residual.white:
        rest = ": the estimates and their standard deviations hold" if not note else ""
        return "valid", f"{head}, and the residual may be treated as white{rest}.{more}", note
    return "autocorrelated", _autocorrelated(residual, head) + more, note


def _percent(test: HypothesisTest) -> float:
    """Size of what a test rejects for, in percent of the torque; 0 where the test has none."""
    return test.torque_deviation_percent or 0.0


def _rejected(instruments: HypothesisTest) -> str:
    percent = instruments.torque_deviation_percent
    size = "" if percent is None else f", {percent:.2g} % of the torque"
    sentence = (
        f"the instruments are rejected (p = {instruments.p_value:.2g}): the simulated motion "
        f"differs from the measured one by more than noise{size}."
    )
    if percent is not None and percent < SMALL_TORQUE_PERCENT:
        # A pendulum without its gravity, 20 of 60 N m, moves the predicted torque by 0.4 %:
        # the loop holds the simulated motion to the reference whatever the model is.
        sentence += " A stiff loop hides most of a model error from this figure."
    return (
        f"{sentence} The model or the control law is wrong here and the estimates are biased: run "
        "idim-iv diagnose, which looks for the missing effect."
    )


def _families(left: Sequence[HypothesisTest]) -> str:
    """What the residual follows, the largest part first."""
    parts = []
    for test in sorted(left, key=_percent, reverse=True):
        family, percent = test.scope.rpartition(": ")[2], _percent(test)
        parts.append(f"the {family} ({percent:.2g} % of the torque, p = {test.p_value:.2g})")
    return _names(parts)


def _autocorrelated(residual: ResidualDiagnosis, head: str) -> str:
    times = residual.sigma_understatement
    side = f"{times:.2g} times too small" if times >= 1.0 else f"{1 / times:.2g} times too large"
    sentence = (
        f"{head}, the residual is autocorrelated, AR({residual.ar_order}): use the refined "
        f"standard deviations; computed as if it were white they would be {side}."
    )
    if residual.whiteness_after.accepted is False:
        sentence += (
            " The filter does not whiten the residual fully (largest correlation that remains "
            f"{residual.largest_correlation_after:.2g}): decimate at a lower cut-off."
        )
    return sentence


def judge_all(joints: Sequence[JointVerdict], instruments: HypothesisTest) -> OverallVerdict:
    """Join the verdicts on all joints with the instrument test of all rows.

    `instruments`: the Wald test of Π = I, scope "all"; it sees what no joint shows alone.
    """
    # Residual beyond the noise first, then the largest rejected deviation.
    largest = sorted(joints, key=lambda j: (-(j.torque_percent or 0.0), -j.rejected_percent))
    wrong = [joint.joint for joint in largest if joint.verdict == "misspecified"]
    inconclusive, autocorrelated = (
        [joint.joint for joint in joints if joint.verdict == kind]
        for kind in ("inconclusive", "autocorrelated")
    )
    small = _small(largest)
    if wrong:
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
    alone = any(joint.rejected for joint in joints)
    sizes = [instruments.torque_deviation_percent, *(joint.torque_percent for joint in joints)]
    little = all(size is not None and size < SMALL_TORQUE_PERCENT for size in sizes)
    if instruments.accepted is False and not (little or alone):
        sentence = (
            "No joint alone rejects its instruments, but all rows together do "
            f"(p = {instruments.p_value:.2g}): a small model error is shared by several joints, "
            "run idim-iv diagnose, which looks for it."
        )
        return OverallVerdict("misspecified", sentence)
    if inconclusive:
        where = "any joint" if len(inconclusive) == len(joints) else _names(inconclusive)
        reason = instruments.reason
        why = f": {reason}." if reason else "; the reason is given with each joint."
        sentence = f"The estimates could not be tested at {where}{why}"
        return OverallVerdict("inconclusive", sentence + small)
    head = "Errors are small." if small else "The instruments are valid."
    if autocorrelated:
        where = "all joints" if len(autocorrelated) == len(joints) else _names(autocorrelated)
        rest = f" The residual is autocorrelated at {where}: use the refined standard deviations."
        return OverallVerdict("autocorrelated", head + rest + small)
    rest = "" if small else " The estimates and their standard deviations hold."
    return OverallVerdict("valid", f"{head} The residuals are white.{rest}{small}")


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
    *first, last = joints
    return f"{', '.join(first)} and {last}" if first else last
