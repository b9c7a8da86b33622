"""A wrong gain of a recorded effort shows in the torque and in the commands: it is one cause."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.controller.check import ControllerFinding, LawCheck, check_law
from idim_iv_ros.diagnosis.controller.significance import together
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import Cause, EffectParameter
from idim_iv_ros.effects.registry import BY_NAME
from idim_iv_ros.simulation import control_law


def beside_gains(
    data: Baseline,
    law: LawCheck,
    causes: Sequence[Cause],
    without: Collection[str] = (),
    *,
    shift: float = 0.0,
) -> LawCheck:
    """Check the law again with the efforts that it commands, where their gain is a cause.

    A gain of the drive alone changes no command. One of what is recorded changes all of them by
    the inverse of the gain: only then, and where the law holds with it, is it the same gain.

    Parameters
    ----------
    law
        Of the efforts as recorded.
    causes
        With the gains that were found in the torque.
    without, shift
        As `check_law`.
    """
    gains = {
        cause.joint: cause.parameters["factor"]
        for cause in causes
        if BY_NAME[cause.effect].part == "torque scale" and cause.joint is not None
    }
    factors = {}
    for found in law.findings:
        if found.joint in gains:
            factor = _factor(data, found, gains[found.joint])
            if factor is not None:
                factors[data.joints.index(found.joint)] = factor
    if not factors:
        return law
    again = check_law(_with_gains(data, factors), without, shift=shift)
    left = {found.joint for found in again.findings}
    same = {joint: each for joint, each in factors.items() if data.joints[joint] not in left}
    if same == factors:
        return again
    return check_law(_with_gains(data, same), without, shift=shift) if same else law


def _factor(data: Baseline, found: ControllerFinding, gain: EffectParameter) -> float | None:
    """From recorded to commanded effort, by the position gain; None where `gain` is another."""
    law = control_law(data.prepared.configuration.controller, len(data.joints))
    configured = float(law.kp[data.joints.index(found.joint)])
    kp = found.parameters.get("kp")
    if kp is None or gain.std is None or kp.value * configured <= 0.0:
        return None
    factor = configured / kp.value
    p_value = together(np.array([factor - gain.value]), np.array([[gain.std**2]]))
    return factor if p_value > settings.SIGNIFICANCE_LEVEL else None


def _with_gains(data: Baseline, factors: Mapping[int, float]) -> Baseline:
    """Return the recordings with other efforts; the rows of the regression stay."""
    scale = np.array([factors.get(joint, 1.0) for joint in range(len(data.joints))])
    motions = tuple(
        replace(motion, signals=replace(motion.signals, torque=motion.signals.torque * scale))
        for motion in data.prepared.motions
    )
    return replace(data, prepared=replace(data.prepared, motions=motions))
