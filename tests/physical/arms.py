"""Small robots and estimates of them with a known covariance."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from idim_iv_ros.configuration import load_configuration
from idim_iv_ros.model import InverseModel, build_inverse_model
from idim_iv_ros.types import FloatArray

CONFIG = Path(__file__).resolve().parents[2] / "config"


@dataclass(frozen=True)
class Estimate:
    """A model, its true base parameters, and the covariance of their estimates."""

    model: InverseModel
    true: FloatArray
    covariance: FloatArray

    def drawn(self, seed: int) -> FloatArray:
        """An estimate of the true parameters with this covariance."""
        noise = np.random.default_rng(seed).normal(size=len(self.true))
        return self.true + np.linalg.cholesky(self.covariance) @ noise


def arm(name: str, *, samples: int, noise: float) -> Estimate:
    """One of the arms in config/, its parameters shown by random states.

    `noise`: standard deviation of the torque, as a share of the given limits of effort.
    """
    configuration = load_configuration(CONFIG / f"{name}.yaml")
    urdf = configuration.robot.urdf
    model = build_inverse_model(configuration, urdf.read_text(), urdf.name)
    random = np.random.default_rng(1)
    shape = (samples, len(model.robot.joints))
    matrix = model.matrix(
        random.uniform(-2.0, 2.0, shape),
        random.uniform(-2.0, 2.0, shape),
        random.uniform(-5.0, 5.0, shape),
    )
    matrix = matrix / (noise * model.robot.limits.effort)[None, :, None]
    stacked = matrix.reshape(-1, matrix.shape[2])
    names = zip(model.base.names, model.given, strict=True)
    truth = configuration.simulated_robot.parameters
    true = np.array([truth.get(name, float(value)) for name, value in names])
    return Estimate(model, true, np.linalg.inv(stacked.T @ stacked))
