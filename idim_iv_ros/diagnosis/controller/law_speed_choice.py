"""Which speed explains the recorded commands of all joints best."""

from collections.abc import Sequence

import numpy as np
import scipy

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.controller.command_regression import comparable_rows
from idim_iv_ros.diagnosis.controller.law_speed import FACTORS, LawSpeed, law_speeds
from idim_iv_ros.effects.controller_mismatch import ControllerMismatch
from idim_iv_ros.signals import Motion
from idim_iv_ros.simulation import ControlLaw
from idim_iv_ros.types import FloatArray


def law_speed(motions: Sequence[Motion], law: ControlLaw) -> LawSpeed:
    """Choose the speed of the law, one for all joints and recordings.

    Constants, the gains and a lag of the command are fitted with each, so that another gain does
    not pass for another speed. The plain central difference stays unless another leaves clearly
    less.
    """
    if not law.torque_gains[1].any():
        return LawSpeed()
    recorded = all(motion.signals.velocity is not None for motion in motions)
    options = law_speeds(recorded)
    scores = _scores(motions, law, options)
    best = int(np.argmin(scores))
    chosen, score = options[best], scores[best]
    if chosen.kind == "filtered" and 0 < (place := FACTORS.index(chosen.factor)) < len(FACTORS) - 1:
        found = scipy.optimize.minimize_scalar(
            lambda factor: _scores(motions, law, [LawSpeed("filtered", float(factor))])[0],
            bounds=(FACTORS[place + 1], FACTORS[place - 1]),
            method="bounded",
            options={"xatol": 1e-3},
        )
        if found.fun < score:
            chosen, score = LawSpeed("filtered", float(found.x)), float(found.fun)
    return chosen if score < (1.0 - settings.LAW_SPEED_GAIN) * scores[0] else options[0]


def _scores(motions: Sequence[Motion], law: ControlLaw, speeds: Sequence[LawSpeed]) -> FloatArray:
    """What each speed leaves of the commands: rms over joints of the share of their size."""
    joints = [joint for joint in range(len(law.kp)) if law.torque_gains[1][joint] > 0.0]
    shares = [
        share for joint in joints if (share := _shares(motions, law, joint, speeds)) is not None
    ]
    return np.sqrt(np.mean(shares, axis=0)) if shares else np.zeros(len(speeds))


def _shares(
    motions: Sequence[Motion], law: ControlLaw, joint: int, speeds: Sequence[LawSpeed]
) -> FloatArray | None:
    """Share of the energy of one joint's command that the law with each speed leaves."""
    plain = LawSpeed()
    gain = float(law.torque_gains[1][joint])
    tables, constants = [], []
    for number, motion in enumerate(motions):
        signals = motion.signals
        central = plain.of(signals, joint)
        parts = ControllerMismatch().parts(signals, law, joint, central)
        recorded = signals.torque[:, joint]
        later = [speed.of(signals, joint) - central for speed in speeds]
        error, slip = parts.groups["kp"], parts.groups["kd"]
        rest = recorded - parts.command
        table = np.column_stack([recorded, rest, parts.rate, error, slip, *later])
        rows = motion.decimation.whole(table[motion.span])[comparable_rows(motion, law, joint)]
        tables.append(rows)
        constants.append(np.full(len(rows), number))
    table = np.concatenate(tables)
    if len(table) < settings.LAW_LEAST_ROWS:
        return None
    which = np.concatenate(constants)
    plain_columns = np.column_stack([which[:, None] == np.unique(which), table[:, 2:4]])
    left = []
    for change in table[:, 5:].T:
        matrix = np.column_stack([plain_columns, table[:, 4] - change])
        rest = table[:, 1] + gain * change
        left.append(float(np.sum((rest - matrix @ np.linalg.lstsq(matrix, rest)[0]) ** 2)))
    return np.array(left) / max(float(np.sum(table[:, 0] ** 2)), 1e-300)
