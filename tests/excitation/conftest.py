"""Robots of config/ and motions designed for the planar arm."""

from pathlib import Path

import pytest

from idim_iv_ros.configuration import load_configuration
from idim_iv_ros.excitation.design import DesignSettings, design_excitation
from idim_iv_ros.excitation.diagnosis import design_diagnosis
from idim_iv_ros.excitation.excite import load_model
from idim_iv_ros.excitation.limits import motion_limits

CONFIG = Path(__file__).resolve().parents[2] / "config"
FLOOR = -0.05
SETTINGS = DesignSettings(period=8.0, repeats=2, rate=200.0, harmonics=4, seed=3)


@pytest.fixture(scope="session")
def robots():
    """Configuration and model by name."""

    def load(name: str):
        configuration = load_configuration(CONFIG / f"{name}.yaml")
        return configuration, load_model(configuration)

    return load


@pytest.fixture(scope="session")
def arm2(robots):
    """Planar arm with the limits that the tests' motions must keep."""
    configuration, model = robots("arm2")
    return configuration, model, motion_limits(model, configuration, margin=0.8, floor=FLOOR)


@pytest.fixture(scope="session")
def design(arm2):
    """A motion for identification of the planar arm above a floor."""
    _, model, limits = arm2
    return design_excitation(model, limits, SETTINGS)


@pytest.fixture(scope="session")
def diagnosis(robots):
    """A motion for diagnosis of the six-joint arm above a floor."""
    configuration, model = robots("arm6")
    limits = motion_limits(model, configuration, margin=0.8, floor=0.1)
    made = design_diagnosis(model, limits, configuration, duration=100.0, rate=200.0)
    return model, limits, made
