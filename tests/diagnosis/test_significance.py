"""When the numbers of a cause are known to differ from zero."""

import numpy as np
import pytest

from idim_iv_ros.diagnosis.parametric.significance import any_differs


@pytest.mark.parametrize(
    ("values", "deviations", "correlation", "known"),
    [
        ((3.0,), (1.0,), 0.0, True),
        ((50.0,), (235.0,), 0.0, False),  # 50 ± 460
        # Each may be zero; their difference is surely not, and says nothing of either.
        ((-0.3, 0.2), (2.8, 1.0), -0.999999, False),
        ((2.2, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0, 1.0), 0.0, False),  # one of four by chance
        ((4.5, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0, 1.0), 0.0, True),
    ],
)
def test_numbers_that_may_all_be_zero_do_not_differ(
    values: tuple[float, ...], deviations: tuple[float, ...], correlation: float, known: bool
) -> None:
    covariance = correlation * np.outer(deviations, deviations)
    covariance[np.diag_indices_from(covariance)] = np.square(deviations)
    assert any_differs(np.array(values), covariance) == known
