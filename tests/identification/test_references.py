"""References that are none of the joints', and those that are in spite of how they are followed."""

import numpy as np
import pytest

from idim_iv_ros.identification.sanity import repeats_motion, wrong_references

TIME = np.arange(3000) / 100.0
REFERENCE = np.column_stack([np.sin(1.7 * TIME), 0.5 * np.sin(0.9 * TIME + 1.0)])


@pytest.mark.parametrize(
    "position",
    [
        pytest.param(np.roll(REFERENCE, 30, axis=0), id="0.3 s late"),
        pytest.param(REFERENCE + np.array([0.4, -0.2]), id="sagging"),
        pytest.param(0.5 * REFERENCE, id="soft"),
        pytest.param(REFERENCE * np.array([1.0, 0.0]), id="a joint that is held"),
        pytest.param(np.roll(REFERENCE, 150, axis=0), id="1.5 s late"),
        pytest.param(REFERENCE * np.array([1.0, 0.2]), id="very soft"),
        pytest.param(REFERENCE[:, [0, 0]] * np.array([1.0, 0.01]), id="shaken by the other"),
    ],
)
def test_a_loop_that_follows_badly_still_follows(position: np.ndarray) -> None:
    assert list(wrong_references(position, REFERENCE, ("a", "b"))) == []


def test_degrees_signs_and_joints_in_another_order_are_named() -> None:
    degrees = dict(wrong_references(REFERENCE, np.degrees(REFERENCE), ("a", "b")))
    assert degrees[0].startswith("its references are 57 times its motion")
    opposite = dict(wrong_references(REFERENCE, -REFERENCE, ("a", "b")))
    assert all("opposite sign" in sentence for sentence in opposite.values())
    swapped = dict(wrong_references(REFERENCE, REFERENCE[:, ::-1], ("a", "b")))
    assert "the references of b" in swapped[0] and "the references of a" in swapped[1]


def test_references_that_are_the_measured_positions_are_no_references() -> None:
    noise = 1e-4 * np.random.default_rng(1).standard_normal(REFERENCE.shape)
    measured = np.roll(REFERENCE, 3, axis=0) + noise
    assert repeats_motion(measured, measured)
    assert repeats_motion(measured[1:], measured[:-1])
    assert not repeats_motion(measured, REFERENCE)
    assert not repeats_motion(measured[:-1], measured[1:])
    assert not repeats_motion(np.zeros((50, 2)), np.zeros((50, 2)))
