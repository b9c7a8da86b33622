"""The sentences of section V, each measured on one noise seed."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.paper_tx40.experiment import (
    APPROPRIATE,
    EMPTY_BAND,
    HUNDRED,
    INAPPROPRIATE,
    MODEL_ERROR,
    Reproduction,
)
from benchmarks.paper_tx40.published import TABLE_1, TABLE_3
from idim_iv_ros import IdentificationResult


@dataclass(frozen=True)
class Outcome:
    """What was measured, in words, and whether the sentence holds."""

    ours: str
    agrees: bool


@dataclass(frozen=True)
class Claim:
    """One sentence of the paper.

    Attributes
    ----------
    section : str
    sentence : str
        In our words.
    paper : str
        The paper's figure.
    measure : function of a Reproduction
    remark : str
        Why ours differs, where it does.
    """

    section: str
    sentence: str
    paper: str
    measure: Callable[[Reproduction], Outcome]
    remark: str = ""


def _iterations(
    name: str, as_published: Callable[[int], bool]
) -> Callable[[Reproduction], Outcome]:
    def measure(run: Reproduction) -> Outcome:
        result = run.results[name]
        return Outcome(str(result.iterations), result.converged and as_published(result.iterations))

    return measure


def essential(run: Reproduction) -> Outcome:
    """All 28 of Table 1 among the essential ones; what else is essential is not zero in truth."""
    names = {p.name for p in run.results[APPROPRIATE].parameters if p.essential}
    missing, more = sorted(set(TABLE_1) - names), sorted(names - set(TABLE_1))
    words = f"{28 - len(missing)} of the 28"
    if missing:
        words += f" (not {', '.join(missing)})"
    if more:
        words += f", and {len(more)} more: {', '.join(more)}"
    return Outcome(words, not missing)


def near_truth(run: Reproduction) -> Outcome:
    """All base parameters within 3 σ of the simulated robot's, but for 1 %."""
    parameters = run.results[APPROPRIATE].parameters
    off = [abs(p.value - run.truth[p.name]) / p.std for p in parameters]
    inside = sum(value < 3.0 for value in off)
    return Outcome(
        f"{inside} of {len(off)} within 3 σ, largest {max(off):.1f} σ", inside >= len(off) - 1
    )


def _wald(name: str, rejected: frozenset[str]) -> Callable[[Reproduction], Outcome]:
    def measure(run: Reproduction) -> Outcome:
        tests = run.results[name].instruments.tests[1:]
        scopes = frozenset(test.scope for test in tests if test.accepted is False)
        untold = [test.scope for test in tests if test.accepted is None]
        words = f"rejected at {_joints(scopes)}" if scopes else "accepted at all joints"
        if untold:
            words = f"not tested: {tests[0].reason}"
        return Outcome(words, scopes == rejected and not untold)

    return measure


def specification(run: Reproduction) -> Outcome:
    """Where the residual follows the motion, once gravity is left out."""
    verdicts = run.results[MODEL_ERROR].residuals
    joints = frozenset(v.joint for v in verdicts if v.verdict == "misspecified")
    wanted = {"joint_1", "joint_2", "joint_3"}
    return Outcome(f"model error at {_joints(joints)}", joints >= wanted)


def white(run: Reproduction) -> Outcome:
    """Whether the residual of every joint may pass for white."""
    residuals = run.results[APPROPRIATE].residuals
    largest = [float(np.abs(r.acf[1:]).max()) for r in residuals]
    bound = max(r.acf_bound for r in residuals)
    accepted = sum(bool(r.white) for r in residuals)
    words = (
        f"largest correlation {min(largest):.2f} to {max(largest):.2f} (95 % bound {bound:.2f}); "
        f"may pass for white at {accepted} of 6 joints"
    )
    return Outcome(words, accepted == 6)


def _gaussian(name: str) -> Callable[[Reproduction], Outcome]:
    def measure(run: Reproduction) -> Outcome:
        residuals = run.results[name].residuals
        kurtosis = max(abs(r.excess_kurtosis) for r in residuals)
        skewness = max(abs(r.skewness) for r in residuals)
        words = f"largest excess kurtosis {kurtosis:.2f}, skewness {skewness:.2f}"
        return Outcome(words, kurtosis < 1.0 and skewness < 0.5)

    return measure


def autocorrelated(run: Reproduction) -> Outcome:
    """Every joint's residual is autocorrelated."""
    residuals = run.results[INAPPROPRIATE].residuals
    first = [float(r.acf[1]) for r in residuals]
    return Outcome(
        f"correlation of neighbours {min(first):.2f} to {max(first):.2f}, "
        f"autocorrelated at {sum(r.white is False for r in residuals)} of 6 joints",
        all(r.white is False for r in residuals),
    )


def _order(name: str, low: int, high: int) -> Callable[[Reproduction], Outcome]:
    def measure(run: Reproduction) -> Outcome:
        orders = sorted(r.ar_order for r in run.results[name].residuals)
        middle = float(np.median(orders))
        return Outcome(f"{orders[0]} to {orders[-1]}, median {middle:g}", low <= middle <= high)

    return measure


def half(run: Reproduction) -> Outcome:
    """Standard deviations as if the residual were white, over those of section V.B."""
    ratios = _ratios(run.results[INAPPROPRIATE], run.results[APPROPRIATE])
    return Outcome(f"median {np.median(ratios):.2f}", bool(0.35 < np.median(ratios) < 0.7))


def honest_again(run: Reproduction) -> Outcome:
    """Refined standard deviations over those of section V.B by the white formula."""
    refined = run.results[INAPPROPRIATE].refined
    assert refined is not None
    first = {p.name: p for p in run.results[APPROPRIATE].parameters}
    listed = [p for p in refined.parameters if p.name in TABLE_1]
    ratio = float(np.median([p.std / first[p.name].white_std for p in listed]))
    corrected = float(np.median([p.std / first[p.name].std for p in listed]))
    return Outcome(
        f"median {ratio:.2f} of the white formula's, as the paper compares; {corrected:.2f} of "
        "those with the autocorrelation taken into account",
        abs(ratio - 1.0) <= 0.15,
    )


def whitened(run: Reproduction) -> Outcome:
    """The residual after the AR filter."""
    residuals = run.results[INAPPROPRIATE].residuals
    largest = max(float(np.abs(r.acf_whitened[1:]).max()) for r in residuals)
    accepted = sum(r.whiteness_after.accepted is True for r in residuals)
    return Outcome(
        f"largest correlation {largest:.3f}, Ljung-Box accepts {accepted} of 6 joints",
        accepted >= 5 and largest < 0.05,
    )


def more_iterations(run: Reproduction) -> Outcome:
    """Iterations with the error in the model and without."""
    wrong, right = run.results[MODEL_ERROR].iterations, run.results[APPROPRIATE].iterations
    return Outcome(f"{wrong} instead of {right}", wrong > right)


def incompatible(run: Reproduction) -> Outcome:
    """Parameters of Table 3 further than 3 σ from the simulated robot's."""
    parameters = [p for p in run.results[MODEL_ERROR].parameters if p.name in TABLE_3]
    off = [p.name for p in parameters if abs(p.value - run.truth[p.name]) > 3.0 * p.std]
    return Outcome(
        f"{len(off)} of {len(parameters)} further than 3 σ: {', '.join(off) or 'none'}", bool(off)
    )


def _ratios(result: IdentificationResult, to: IdentificationResult) -> list[float]:
    first = {p.name: p.white_std for p in to.parameters}
    return [p.white_std / first[p.name] for p in result.parameters if p.name in TABLE_1]


def _joints(names: frozenset[str]) -> str:
    numbers = ", ".join(sorted(name.removeprefix("joint_") for name in names))
    return f"joint{'s' if len(names) > 1 else ''} {numbers}" if names else "no joint"


_FIRST_FOUR = frozenset({"joint_1", "joint_2", "joint_3", "joint_4"})

CLAIMS = (
    Claim(
        "V.B", "IDIM-IV converges in 3 iterations", "3", _iterations(APPROPRIATE, lambda n: n <= 4)
    ),
    Claim(
        "V.B",
        "28 essential parameters of 60 describe the dynamics",
        "28 of 60",
        essential,
        "The simulated robot's other parameters are small, not zero; this recording shows some.",
    ),
    Claim("V.B", "the estimates are consistent", "no truth known", near_truth),
    Claim(
        "V.B",
        "the Wald test accepts the instruments at all joints",
        "accepted",
        _wald(APPROPRIATE, frozenset()),
    ),
    Claim(
        "V.B",
        "the residual is white",
        "no significant correlation (figure 1)",
        white,
        "The disturbance of the simulated joints ends at 10 Hz, the paper's bandwidth, as a "
        "first-order low-pass does. At 42 rows per second neighbours then share a quarter of "
        "their variance or less: invisible in a figure of the pooled residual, significant in a "
        "test. The white formula for σ is 1.0 to 1.4 times too small.",
    ),
    Claim("V.B", "its histogram is Gaussian", "figure 2", _gaussian(APPROPRIATE)),
    Claim(
        "V.C",
        "the Wald test still accepts at all joints",
        "accepted",
        _wald(INAPPROPRIATE, frozenset()),
        "Tested on rows no denser than the loop is fast; on all rows a right model is rejected.",
    ),
    Claim("V.C", "the residual is autocorrelated", "figure 3", autocorrelated),
    Claim(
        "V.C",
        "AIC finds an autoregressive order near 50",
        "50",
        _order(INAPPROPRIATE, 35, 70),
        "The order is that of the error's spectrum and of the decimation filter: see the next "
        "line. A first-order disturbance with white noise needs fewer coefficients.",
    ),
    Claim(
        "V.C",
        "the same, with MATLAB's decimation filter",
        "50",
        _order(EMPTY_BAND, 35, 70),
        "This filter ends at 0.8 of the new Nyquist frequency. The empty band above is "
        "predictable, and AIC spends coefficients on it.",
    ),
    Claim(
        "V.C",
        "decimated at 100 Hz the order is near 10",
        "10",
        _order(HUNDRED, 7, 14),
        "It falls in proportion to the rate here too, from a lower order.",
    ),
    Claim(
        "V.C",
        "σ computed as if the residual were white is about half",
        "0.5",
        half,
        "Ours is smaller still: the ratio depends on how much noise there is beyond the bandwidth.",
    ),
    Claim(
        "V.C",
        "the refined σ is that of appropriate filtering again, within 15 %",
        "1.0",
        honest_again,
        "Rows that are whitened at a high rate hold a little more than those that were decimated.",
    ),
    Claim("V.C", "the refined residual is white", "white", whitened),
    Claim("V.C", "its histogram is Gaussian", "figure 4", _gaussian(INAPPROPRIATE)),
    Claim(
        "V.D",
        "more iterations are needed with the error in the model",
        "5 instead of 3",
        more_iterations,
        "The gains of the simulated loop are known and high: its motion hardly depends on the "
        "model, and the iteration ends as soon.",
    ),
    Claim(
        "V.D",
        "the Wald test rejects at joints 1 to 4 and accepts at 5 and 6",
        "joints 1 to 4",
        _wald(MODEL_ERROR, _FIRST_FOUR),
        "The loops have integral action: they hold the motion to its reference without gravity in "
        "the model too, and simulated and measured motion agree. Whether and where the test "
        "rejects depends on the noise seed.",
    ),
    Claim(
        "V.D",
        "the verdict (instruments, or residual that follows the motion) finds the error",
        "not in the paper",
        specification,
        "The residual of the torque shows what the motion hides.",
    ),
    Claim("V.D", "the estimates are incompatible with Table 1", "Table 3", incompatible),
)
