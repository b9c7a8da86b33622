"""Section V of the paper on the simulated TX40: every sentence, over several noise seeds.

Where a sentence of the paper does not hold on the simulated robot, the test asserts what was
measured instead and says why.
"""

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest

from benchmarks.paper_tx40 import claims
from benchmarks.paper_tx40.experiment import (
    APPROPRIATE,
    EMPTY_BAND,
    HUNDRED,
    INAPPROPRIATE,
    MODEL_ERROR,
    Reproduction,
    reproduce,
)
from benchmarks.paper_tx40.published import TABLE_1

# Of these the tests below say what was measured instead.
DIFFERENT = {
    "28 essential parameters of 60 describe the dynamics",
    "the residual is white",
    "AIC finds an autoregressive order near 50",
    "decimated at 100 Hz the order is near 10",
    "σ computed as if the residual were white is about half",
    "more iterations are needed with the error in the model",
    "the Wald test rejects at joints 1 to 4 and accepts at 5 and 6",
}
QUICK = (1, 2)
FULL = (1, 2, 3, 4, 5)


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(QUICK, marks=pytest.mark.bench),
        pytest.param(FULL, marks=pytest.mark.slow),
    ],
    ids=["quick", "full"],
)
def runs(request: pytest.FixtureRequest, tmp_path_factory) -> list[Reproduction]:
    folder: Path = tmp_path_factory.mktemp("paper")
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        return list(pool.map(reproduce, request.param, [folder] * len(request.param)))


def orders(run: Reproduction, name: str) -> float:
    return float(np.median([r.ar_order for r in run.results[name].residuals]))


@pytest.mark.parametrize(
    "claim",
    [claim for claim in claims.CLAIMS if claim.sentence not in DIFFERENT],
    ids=lambda claim: f"{claim.section}: {claim.sentence}",
)
def test_a_sentence_of_the_paper_holds_on_every_seed(runs, claim: claims.Claim) -> None:
    for outcome in map(claim.measure, runs):
        assert outcome.agrees, outcome.ours


def test_the_28_essential_parameters_are_found_from_60(runs) -> None:
    """MX4 has 20 % in the paper, too: it may be missed on one recording."""
    for run in runs:
        parameters = run.results[APPROPRIATE].parameters
        assert len(parameters) == 60
        essential = {p.name for p in parameters if p.essential}
        assert len(set(TABLE_1) - essential) <= 1
        assert set(TABLE_1) - essential <= {"MX4", "XX3"}
        assert len(essential) <= 36


def test_appropriate_residual_is_nearly_white_and_gaussian(runs) -> None:
    """The paper calls it white. Here neighbours share up to a tenth of their variance.

    The disturbance ends at 10 Hz as a first-order low-pass does, and a test sees that: σ by the
    white formula is up to 1.5 times too small.
    """
    for run in runs:
        for residual in run.results[APPROPRIATE].residuals:
            assert np.abs(residual.acf[1:]).max() < 0.45
            assert 0.9 < residual.sigma_understatement < 1.6
            assert abs(residual.excess_kurtosis) < 1.0


def test_order_near_50_is_that_of_matlabs_decimation_filter(runs) -> None:
    """With a filter that leaves no empty band the same residual takes 9 to 25 coefficients."""
    for run in runs:
        assert 40 <= orders(run, EMPTY_BAND) <= 60
        assert 8 <= orders(run, INAPPROPRIATE) <= 25


def test_order_falls_with_the_rate(runs) -> None:
    """The paper's falls from 50 to 10, a fifth like the rate; ours from 14 to 2 or 3."""
    for run in runs:
        assert orders(run, HUNDRED) <= 0.4 * orders(run, INAPPROPRIATE)


def test_white_formula_promises_half_the_standard_deviation_or_less(runs) -> None:
    for run in runs:
        first = {p.name: p.white_std for p in run.results[APPROPRIATE].parameters}
        dense = run.results[INAPPROPRIATE].parameters
        ratio = np.median([p.white_std / first[p.name] for p in dense if p.name in TABLE_1])
        assert 0.2 < ratio < 0.6


def test_without_gravity_the_error_is_found_at_the_first_joints_and_not_at_the_last(runs) -> None:
    """By the instruments or by the residual that follows the motion.

    The paper's Wald test rejects at joints 1 to 4. These loops have integral action, so that the
    motion hardly shows the error: the Wald test alone rejects at some of joints 1 to 3.
    """
    first_four = {f"joint_{k}" for k in range(1, 5)}
    for run in runs:
        result = run.results[MODEL_ERROR]
        wrong = {v.joint for v in result.residuals if v.verdict == "misspecified"}
        assert {"joint_1", "joint_2", "joint_3"} <= wrong <= first_four
        tests = result.instruments.tests[1:]
        assert {test.scope for test in tests if not test.accepted} <= first_four
        assert result.verdict.verdict == "misspecified"
