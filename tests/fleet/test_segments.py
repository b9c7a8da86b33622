"""A bag that is identified in segments has the answer of the whole bag."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bags import simulated_arms
from idim_iv_ros.configuration import Configuration, load_configuration
from idim_iv_ros.errors import DataError
from idim_iv_ros.fleet.regression import bag_fields
from idim_iv_ros.identification.prepare import configured_request
from idim_iv_ros.recording import write_bag
from idim_iv_ros.recording.bags.folder import Bag
from idim_iv_ros.recording.read import read_segments
from tests.estimation.test_simulated_arms import truth_of
from tests.fleet.conftest import CONFIG
from tests.inputs import changed


@pytest.fixture(scope="module")
def arm() -> simulated_arms.SimulatedArm:
    return simulated_arms.arm2(seconds=24.0, rate=250.0)


@pytest.fixture(scope="module")
def bag(arm: simulated_arms.SimulatedArm, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("long") / "run.mcap"
    write_bag(path, simulated_arms.joint_topics(arm, simulated_arms.record(arm, 1)))
    return path


def filtered_as(position: float, decimation: float) -> Configuration:
    """The configuration with filters that do not depend on what is recorded."""
    configuration = load_configuration(CONFIG)
    cutoffs = {"position_cutoff": position, "decimation_cutoff": decimation}
    update = {**cutoffs, "minimum_speed": [0.05, 0.05]}
    return changed(configuration, "processing", **update)


def fields(bag: Path, configuration: Configuration, seconds: float) -> dict[str, Any]:
    request = configured_request(configuration)
    return bag_fields(read_segments(Bag(bag), request, seconds), configuration)


@pytest.mark.parametrize(
    "reference", ["/joint_reference", pytest.param(None, marks=pytest.mark.slow)]
)
def test_segments_give_the_true_parameters_as_the_whole_bag_does(arm, bag, reference) -> None:
    configuration = filtered_as(20.0, 8.0)
    configuration = changed(configuration, "signals", reference=reference)
    whole, parts = (fields(bag, configuration, seconds) for seconds in (60.0, 8.0))
    assert parts["checks"][0] == "read in 3 segments"
    assert 0.9 < parts["rows"] / whole["rows"] < 1.0  # four edges more
    truth = truth_of(arm)
    for answer in (whole, parts):
        assert answer["estimator"] == ("idim-iv" if reference else "idim-ls")
        expected = np.array([truth[name] for name in answer["names"]])
        assert np.abs((answer["values"] - expected) / answer["std"]).max() < 4.0
    np.testing.assert_allclose(parts["std"], whole["std"], rtol=0.25)


def test_a_segment_without_an_estimate_is_left_out(bag: Path) -> None:
    configuration = load_configuration(CONFIG)
    request = configured_request(configuration)
    segments = list(read_segments(Bag(bag), request, 8.0))
    whole = bag_fields(segments[1:], configuration)
    answer = bag_fields([DataError("it holds nothing"), *segments[1:]], configuration)
    assert answer["checks"][-1] == "a segment is left out: it holds nothing"
    assert answer["values"] == whole["values"]
    with pytest.raises(DataError, match="it holds nothing"):
        bag_fields([DataError("it holds nothing")], configuration)
