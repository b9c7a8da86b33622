"""What an identified model predicts of the efforts while the robot runs."""

from idim_iv_ros.prediction.identified_model import IdentifiedModel, identified_model
from idim_iv_ros.prediction.live import LivePrediction, Prediction
from idim_iv_ros.prediction.stream import JointSamples

__all__ = ["IdentifiedModel", "JointSamples", "LivePrediction", "Prediction", "identified_model"]
