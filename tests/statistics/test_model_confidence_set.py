"""The set against Hansen, Lunde and Nason's as the package arch 8.0.0 computes it.

    from arch.bootstrap import MCS
    MCS(losses(), size=0.05, reps=20000, block_size=1, method="max", bootstrap="mbb", seed=1)

gives p = 1, 0.4836, 0.4836, 0.4836, 0, 0. Ours allows for few blocks (b / (b − 1)) and is larger.
"""

import numpy as np
import pytest

from idim_iv_ros.statistics.model_confidence_set import model_confidence_set


def losses(blocks: int = 24, seed: int = 7) -> np.ndarray:
    """Six models, each block with a level of its own; the last ones are worse."""
    random = np.random.default_rng(seed)
    own = random.standard_normal((blocks, 6))
    level = 3.0 * random.standard_normal((blocks, 1))
    return own + level + np.array([0.0, 0.1, 0.3, 0.5, 0.8, 1.5])


def test_set_is_that_of_another_program() -> None:
    found = model_confidence_set(losses(), 0.05, seed=1, draws=20000)
    assert found.included == (0, 1, 2, 3)
    assert found.p_values == pytest.approx([1.0, 0.484, 0.484, 0.484, 0.0, 0.0], abs=0.03)


@pytest.mark.parametrize("blocks", [6, 12, 40])
def test_the_best_model_is_in_the_set_as_often_as_claimed(blocks: int) -> None:
    """Five equal models, so that any of them is the best: the first is missed in 5 % at most."""
    random = np.random.default_rng(blocks)
    missed = sum(
        0 not in model_confidence_set(random.standard_normal((blocks, 5)), 0.05, seed=k).included
        for k in range(300)
    )
    assert missed <= 0.08 * 300


def test_a_model_that_is_worse_everywhere_leaves() -> None:
    table = losses(12)
    table[:, 5] = table[:, 0] + 1.0
    assert 5 not in model_confidence_set(table, 0.05, seed=3).included


def test_models_that_are_the_same_stay() -> None:
    table = np.repeat(losses(12)[:, :1], 3, axis=1)
    assert model_confidence_set(table, 0.05, seed=3).included == (0, 1, 2)


@pytest.mark.parametrize("unit", [2.0**-700, 2.0**700])
def test_the_unit_of_the_losses_decides_nothing(unit: float) -> None:
    found, other = (
        model_confidence_set(each, 0.05, seed=1) for each in (losses(), unit * losses())
    )
    assert other.p_values == pytest.approx(found.p_values, abs=0.0)


def test_a_model_of_no_chance_leaves_the_others_as_they_are() -> None:
    table = np.column_stack([losses(), losses()[:, 0] + 1e200])
    found = model_confidence_set(table, 0.05, seed=1)
    assert found.p_values[:-1] == pytest.approx(
        model_confidence_set(losses(), 0.05, seed=1).p_values, abs=0.0
    )
    assert found.p_values[-1] == 0.0


@pytest.mark.parametrize("table", [np.ones((1, 2)), np.array([[1.0, np.nan], [2.0, 1.0]])])
def test_what_cannot_be_compared_is_refused(table: np.ndarray) -> None:
    with pytest.raises(ValueError, match="finite losses on two blocks"):
        model_confidence_set(table, 0.05, seed=0)
