"""The R factor against NumPy, and least squares where normal equations fail."""

import numpy as np
import pytest

from idim_iv_ros.estimation.qr import (
    BLOCK,
    independent_basis,
    r_factor,
    stacked_r_factor,
    streamed_r_factor,
)


def tall(rows: int, columns: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((rows, columns))


@pytest.mark.parametrize("rows", [3, 5, 200, 2 * BLOCK + 17])
def test_r_factor_is_triangular_and_keeps_all_products(rows: int) -> None:
    matrix = tall(rows, 5)
    factor = r_factor(matrix)
    assert factor.shape == (min(rows, 5), 5)
    np.testing.assert_array_equal(factor, np.triu(factor))
    np.testing.assert_allclose(factor.T @ factor, matrix.T @ matrix, rtol=1e-10, atol=1e-9)


def test_blocks_give_the_r_factor_of_all_rows_but_for_signs() -> None:
    matrix = tall(300, 4)
    blocks = (matrix[:7], matrix[7:7], matrix[7:290], matrix[290:])
    streamed = streamed_r_factor(blocks, 4)
    np.testing.assert_allclose(np.abs(streamed), np.abs(r_factor(matrix)), rtol=1e-10)
    assert streamed_r_factor((), 4).shape == (0, 4)


def test_parts_with_some_of_the_columns_stack_as_their_wide_rows() -> None:
    first, second = tall(50, 2, 1), tall(60, 2, 2)
    wide = np.zeros((110, 3))
    wide[:50, [0, 2]], wide[50:, [1, -1]] = first, second
    stacked = stacked_r_factor([first, second], [np.array([0, 2]), np.array([1, -1])], 3)
    np.testing.assert_allclose(stacked.T @ stacked, wide.T @ wide, atol=1e-12)


def test_a_column_that_depends_on_those_before_it_is_dropped_whatever_its_unit() -> None:
    free = tall(40, 3)
    columns = np.column_stack([free[:, 0], 1e9 * free[:, 0], free[:, 1], np.zeros(40), free[:, 2]])
    basis = independent_basis(columns * [1e-12, 1.0, 1.0, 1.0, 1e7])
    assert basis.kept.tolist() == [0, 2, 4]
    target = free @ [2.0, -1.0, 0.5]
    np.testing.assert_allclose(
        basis.solve(target, 5), [2e12, 0.0, -1.0, 0.0, 0.5e-7], rtol=1e-10, atol=1e-20
    )
    np.testing.assert_allclose(basis.remove(target), 0.0, atol=1e-12)


def test_leading_columns_are_solved_as_if_the_others_were_not_there() -> None:
    columns, target = tall(80, 5), tall(80, 1, 9)[:, 0]
    columns[:, 1] = 3.0 * columns[:, 0]
    leading = independent_basis(columns).leading(4)
    expected = np.linalg.lstsq(columns[:, [0, 2, 3]], target, rcond=None)[0]
    np.testing.assert_allclose(leading.solve(target, 5)[[0, 2, 3]], expected)
    root = leading.inverse_root(5)[[0, 2, 3]]
    kept = columns[:, [0, 2, 3]]
    np.testing.assert_allclose(root @ root.T, np.linalg.inv(kept.T @ kept), rtol=1e-10)


def test_columns_that_normal_equations_cannot_tell_apart_are_solved() -> None:
    """Läuchli's matrix: XᵀX is singular in floating point from ε = 1e-8 on."""
    small = 1e-7
    columns = np.vstack([np.ones(3), small * np.eye(3)])
    truth = np.array([1.0, 2.0, 3.0])
    assert np.linalg.cond(columns.T @ columns) > 1e13
    solution = independent_basis(columns).solve(columns @ truth, 3)
    np.testing.assert_allclose(solution, truth, rtol=1e-7)
