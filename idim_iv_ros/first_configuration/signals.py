"""What the signals show: whether efforts are torques or currents, and a control law."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from idim_iv_ros.identification.effort_statistics import effort_statistics
from idim_iv_ros.identification.prepare import PreparedRegression
from idim_iv_ros.signals.motion import Motion
from idim_iv_ros.simulation import fit_controller

_LEAST_SHARE = 0.05  # of what friction leaves of the effort's variance
_LEAST_RATIO = 5.0  # standard deviations
_SAME = (0.5, 2.0)  # effort over torque: masses of a URDF are not that far off
_OVER_LIMIT = 1.5

_LEAST_R_SQUARED = 0.95
_LARGEST_DEVIATION = 0.1  # of a gain
_DIGITS = 4
# Hz. Noise of the positions grows in the velocity with its frequency and would lower kd; a motion
# that identifies a robot has nothing above this.
_HIGHEST_CUTOFF = 30.0
_UNKNOWN: dict[str, object] = {"type": "unknown"}


def guess_effort_unit(prepared: PreparedRegression) -> tuple[str, str]:
    """Unit of the efforts, ``N m`` or ``A``, and why it is taken for that.

    Recorded efforts are compared with the torques of the URDF's masses, then with its limits.

    Friction and the inertia of the joint's own drive, which no URDF gives, are left free: the ratio
    is seen on gravity and on the other joints' motion. A sign that is opposite is no other unit.
    """
    names = prepared.configuration.robot.joints
    statistics = effort_statistics(prepared.model, prepared.motions, prepared.cutoffs)
    ratios = {
        name: statistic.torque.value
        for name, statistic in zip(names, statistics, strict=True)
        if statistic is not None
        and statistic.torque is not None
        and statistic.torque.of_rest > _LEAST_SHARE
        and abs(statistic.torque.certainty) > _LEAST_RATIO
    }
    if ratios:
        listed = ", ".join(f"{name} {ratio:.2g}" for name, ratio in ratios.items())
        measured = f"effort over the torque that the URDF's masses need: {listed}"
        if _SAME[0] <= float(np.median(np.abs(list(ratios.values())))) <= _SAME[1]:
            return "N m", measured
        return "A", f"{measured}: not a torque, probably a motor current"
    # The size of what friction leaves: a simulator's damping knows no limit.
    peaks = np.array([0.0 if statistic is None else statistic.peak for statistic in statistics])
    most_effort = prepared.model.robot.limits.effort
    limited = np.isfinite(most_effort) & (most_effort > 0.0)
    if not limited.any():
        return "N m", "not known: the URDF has neither masses nor effort limits to compare with"
    shares = np.where(limited, peaks / np.where(limited, most_effort, 1.0), 0.0)
    most = int(np.argmax(shares))
    text = f"largest effort of {names[most]} is {100 * shares[most]:.2g} % of the URDF's limit"
    if shares[most] > _OVER_LIMIT:
        return "A", f"{text}: not a torque"
    return "N m", f"not sure: {text}, and the masses do not show in the efforts"


def propose_law(motions: Sequence[Motion]) -> tuple[dict[str, object], str]:
    """Keys of the section `controller`: a PD law if one explains the efforts; and why."""
    if any(motion.signals.position_reference is None for motion in motions):
        return dict(_UNKNOWN), "no reference in the bag"
    fits = []
    for motion in motions:
        signals, cutoff = motion.signals, min(motion.signals.rate / 10.0, _HIGHEST_CUTOFF)
        # Delays of whole samples, and of whole samples and a half: one that is off by half a sample
        # T shows as kd off by kp T / 2.
        later = np.concatenate([signals.torque[1:], signals.torque[-1:]])
        between = replace(signals, torque=0.5 * (signals.torque + later))
        pairs = ((signals, 0.0), (between, 0.5))
        fits += [(fit_controller(some, cutoff=cutoff), half) for some, half in pairs]
    fit, half = max(fits, key=lambda pair: float(pair[0].r_squared.sum()))
    worst = float(fit.r_squared.min())
    if worst < _LEAST_R_SQUARED:
        return dict(_UNKNOWN), (
            f"a PD law explains only R² = {worst:.2f} of a joint's effort; every identification "
            "fits its own"
        )
    # What the control holds from one sample to the next acts half a sample late on average; the
    # simulation of the loop holds it likewise, so that this is no delay of its own.
    delay = max(fit.delay + half - 0.5, 0.0) / fit.rate
    kp, kd = fit.gain("kp"), fit.gain("kd")
    has = dict(zip(fit.terms, fit.included.T, strict=True))  # (n_joints,) of each term
    forward = has["reference_velocity"]
    on_measured = forward & (np.abs(fit.gain("reference_velocity") + kd) < 0.2 * np.abs(kd))
    uncertain = np.abs(fit.std[:, :2]) > _LARGEST_DEVIATION * np.abs(fit.gains[:, :2])
    beyond = [t for t in ("reference_acceleration", "reference_direction") if has[t].any()]
    if forward.any() and not on_measured.all():
        beyond.append("reference_velocity")
    why = ""
    if np.any(kp <= 0.0) or np.any(kd <= 0.0):
        why = "the fitted gains are not all positive"
    elif uncertain.any():
        why = "the log does not show the gains to 10 %"
    elif beyond:
        why = f"the law has feedforward terms ({', '.join(beyond)})"
    if why:
        return dict(_UNKNOWN), f"{why}; every identification fits its own law"
    keys: dict[str, object] = {"type": "pd", "kp": _rounded(kp), "kd": _rounded(kd)}
    if has["ki"].any():
        keys["ki"] = _rounded(fit.gain("ki"))
    if on_measured.all():
        keys["velocity_reference"] = False
    if delay > 0.0:
        keys["delay"] = round(delay, 6)
    deviation = 100.0 * float(np.max(np.abs(fit.std[:, :2] / fit.gains[:, :2])))
    return keys, (
        f"fitted from the log, R² ≥ {worst:.3f}, σ of the gains up to {deviation:.2g} %; replace "
        "them by those of the real controller"
    )


def _rounded(values: np.ndarray) -> list[float]:
    return [float(f"{value:.{_DIGITS}g}") for value in values]
