"""The arm with six joints of the demo, identified by least squares."""

from pathlib import Path

import pytest

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.model import build_inverse_model
from idim_iv_ros.prediction.identified_model import IdentifiedModel, identified_model
from idim_iv_ros.recording.recording import Recording
from tests.prediction.arm6 import configured, recorded, urdf_of, write_result


@pytest.fixture(scope="session")
def configuration() -> Configuration:
    return configured()


@pytest.fixture(scope="session")
def recording() -> Recording:
    return recorded()


@pytest.fixture(scope="session")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_result(tmp_path_factory.mktemp("identified") / "result.json")


@pytest.fixture(scope="session")
def identified(result: Path, configuration: Configuration) -> IdentifiedModel:
    model = build_inverse_model(configuration, *urdf_of(configuration))
    return identified_model(result, configuration, model, urdf_of(configuration)[1])
