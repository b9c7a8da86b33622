"""Effects that rest on pulses which none of the catalogue explains."""

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.controller.law_event import beside_no_event
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.structural.causes import NamedModel
from idim_iv_ros.types import FloatArray

# Mean square of an effect between the pulses, over that of all rows, from which on it acts there.
_ACTS_BETWEEN = 0.5


def why_of_pulses(data: Baseline, model: NamedModel, number: int) -> str:
    """Why an effect is not that of the catalogue; empty where it is needed between the pulses.

    What follows a pulse, in the motion and in the command, looks like a delay or a friction. An
    effect that acts all the time is there without the pulses; one that acts where they are, such as
    at reversals, cannot be told from them so and stays.
    """
    candidate = model.found[number].candidate
    joint = candidate.place.joint
    noise, rows = model.fit.noise_models[joint], model.regression.extended[joint]
    white = noise.standardized(model.fit.residuals[joint], rows.segments)
    time = data.counting(joint, [each.elapsed[each.decimation.kept] for each in data.motions])
    calm = beside_no_event(white, data.recordings[joint], time)
    power = (candidate.columns[joint] @ candidate.coefficients) ** 2
    if calm.all() or np.mean(power[calm]) < _ACTS_BETWEEN * np.mean(power):
        return ""
    matrix = noise.standardized(rows.matrix, rows.segments)[calm]
    torque = noise.standardized(rows.torque, rows.segments)[calm]
    start = model.regression.parameters + sum(model.regression.widths[:number])
    others = (rows.columns < start) | (rows.columns >= start + candidate.width)
    gain = 0.5 * len(torque) * np.log(_left(matrix[:, others], torque) / _left(matrix, torque))
    if gain - 0.5 * candidate.numbers * np.log(len(torque)) >= settings.LEAST_SUPPORT:
        return ""
    return "it is not seen between the pulses that it does not explain"


def _left(matrix: FloatArray, torque: FloatArray) -> float:
    """Energy that least squares of a torque on the columns of a matrix leave."""
    rest = torque - matrix @ np.linalg.lstsq(matrix, torque, rcond=None)[0]
    return max(float(rest @ rest), 1e-300)
