"""From a configuration to the files of a motion."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import UsageError
from idim_iv_ros.excitation.design import Design, design_excitation
from idim_iv_ros.excitation.design_settings import DesignSettings
from idim_iv_ros.excitation.documents import FORMAT, limits_document, use_document
from idim_iv_ros.excitation.limits import MotionLimits
from idim_iv_ros.excitation.prediction import PredictedParameter, predict_parameters
from idim_iv_ros.model import InverseModel, build_inverse_model, read_urdf_file

_LEAST_NOISE = 1e-6  # of the torque limit: no effort is measured more finely


@dataclass(frozen=True)
class Excitation:
    """A motion for identification with its figures.

    Attributes
    ----------
    design : Design
    parameters : tuple of PredictedParameter
        The worst first.
    torque_noise : float
        Share of each torque limit that `parameters` assumes.
    criterion : str
        What the design minimised.
    document : mapping
        All figures, as they are written to JSON.
    """

    design: Design
    parameters: tuple[PredictedParameter, ...]
    torque_noise: float
    criterion: str
    document: Mapping[str, object] = field(repr=False)


def load_model(configuration: Configuration) -> InverseModel:
    """Build the nominal model, with torques in N m whatever the recordings hold.

    Raises
    ------
    UsageError
        The configuration names no URDF, or one that cannot be used.
    """
    urdf = configuration.robot.urdf
    if urdf is None:
        raise UsageError(f"{configuration.source}: robot.urdf is needed to design a motion")
    text = read_urdf_file(urdf)
    signals = configuration.signals.model_copy(update={"effort_unit": "N m"})
    return build_inverse_model(
        configuration.model_copy(update={"signals": signals}), text, str(urdf)
    )


def excite(
    model: InverseModel,
    limits: MotionLimits,
    settings: DesignSettings,
    *,
    torque_noise: float = 0.005,
    progress: Callable[[str, float], None] | None = None,
) -> Excitation:
    """Design a motion for identification and predict what it shows.

    Parameters
    ----------
    torque_noise
        Standard deviation of the torque noise at each sample, share of the torque limit.

    Raises
    ------
    UsageError, DataError
        See `motion_limits`, `design_excitation`, `predict_parameters`.
    """
    if not _LEAST_NOISE <= torque_noise < 1.0:
        raise UsageError(
            f"torque noise {torque_noise:g}: a share from {_LEAST_NOISE:g} to below 1 is needed"
        )
    design = design_excitation(model, limits, settings, progress)
    parameters = predict_parameters(
        model, design.period, settings.repeats, limits.torque, torque_noise
    )
    document: dict[str, object] = {
        "format": FORMAT,
        "purpose": "identification",
        "robot": model.robot.name,
        "joints": list(model.robot.joints),
        "settings": {
            **{name: value for name, value in settings.__dict__.items() if name != "start"},
            "start": None if settings.start is None else [float(q) for q in settings.start],
            "torque_noise": torque_noise,
        },
        "ended_early": design.ended_early,
        "seconds": round(design.seconds, 2),
        "duration": design.trajectory.duration,
        "condition_number": {
            "random_median": design.before.__dict__,
            "designed": design.after.__dict__,
        },
        "limits": limits_document(limits),
        "use": use_document(design.use),
        "parameters": [
            {**p.__dict__, "relative_std": p.relative_std, "bad": p.bad} for p in parameters
        ],
    }
    return Excitation(design, parameters, torque_noise, settings.criterion, document)
