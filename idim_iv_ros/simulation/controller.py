"""Control laws of the recorded robot: as configured, or fitted to its logged signals."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from idim_iv_ros.configuration import ControllerSection
from idim_iv_ros.effects.control_law import ControlLaw
from idim_iv_ros.errors import UsageError
from idim_iv_ros.signals.joint_side import JointSignals
from idim_iv_ros.types import FloatArray

# Always in the law; the others enter only where they lower the residual's energy by this share.
LAW = ("kp", "kd", "bias")
CANDIDATES = ("ki", "reference_velocity", "reference_acceleration", "reference_direction")
CLEAR_IMPROVEMENT = 0.2
# The worst ratio of the law's unit-scaled columns' singular values that a term may cause.
COLLINEAR = 1e-3
LONGEST_DELAY = 3  # samples from the errors to the torque that are tried


def factor_of_lateness(lateness: float, period: float) -> float | None:
    """Filter of differences over a control period that is as late as another speed, both in s.

    A backward difference is half a period late, and a filter of factor f another (1 − f) / f
    periods (its group delay at low frequencies). Returns 0 < f ≤ 1, or None where differences over
    the period are later than that: the exact speed is then as near.
    """
    if lateness < 0.5 * period * (1.0 - 1e-9):
        return None
    return min(1.0, period / (lateness + 0.5 * period))


def control_period(section: ControllerSection, rates: Iterable[float]) -> float:
    """Period of the control, s: the configured one, or what the rates of the recordings, Hz, tell.

    A robot has one controller, at least as fast as the fastest of its recordings.
    """
    return section.period if section.period is not None else 1.0 / max(rates)


def control_law(section: ControllerSection, n_joints: int) -> ControlLaw:
    """Build the law that a configuration describes.

    Raises UsageError: the configuration says that the law is unknown; it must be fitted
    (`fit_controller`).
    """
    if section.type == "unknown":
        raise UsageError("controller.type is unknown: there is no law to simulate")
    kp, kd = _values(section.kp, 0.0, n_joints), _values(section.kd, 0.0, n_joints)
    cascade = section.type == "cascade"
    if cascade:
        kd = _values(section.drive_gain, 1.0, n_joints) * _values(section.kv, 0.0, n_joints)
        kp = kd * kp
    return ControlLaw(
        kp=kp,
        kd=kd,
        ki=_values(section.ki, 0.0, n_joints),
        velocity_reference=section.velocity_reference and not cascade,
        torque_limit=_values(section.torque_limit, np.inf, n_joints),
        period=section.period,
        delay=section.delay,
    )


def _values(given: Sequence[float] | None, default: float, n_joints: int) -> FloatArray:
    return np.full(n_joints, default) if given is None else np.asarray(given, dtype=float)


@dataclass(frozen=True)
class ControllerFit:
    """Law of each joint fitted to the logged torque: τ = Σ gain · term."""

    # ``kp`` (position error), ``kd`` (velocity error), ``bias``, ``ki`` (integral of the position
    # error), and feedforward of ``reference_velocity``, ``reference_acceleration``,
    # ``reference_direction`` (its sign). A law with −dq in its kd term shows as a
    # reference_velocity gain of −kd.
    terms: tuple[str, ...]
    # gains, std: (n_joints, n_terms): zero where a joint's law leaves a term out. The standard
    # deviations allow for the residual's autocorrelation at one sample.
    gains: FloatArray
    std: FloatArray
    included: NDArray[np.bool_]  # (n_joints, n_terms) bool
    # (n_joints,): share of the (low-passed) torque's variance that the law explains
    r_squared: FloatArray
    delay: int  # Samples from the errors to the torque, common to all joints
    rate: float  # Hz
    cutoff: float  # Low-pass of all signals before the regression, Hz

    def gain(self, term: str) -> FloatArray:
        """Gains (n_joints,) of one term."""
        return np.asarray(self.gains[:, self.terms.index(term)])

    def describe(self, joint: int) -> str:
        """Say the law of one joint in one line."""
        parts = [
            f"{term} {self.gains[joint, k]:.3g} ± {self.std[joint, k]:.2g}"
            for k, term in enumerate(self.terms)
            if self.included[joint, k]
        ]
        delay = f", delay {self.delay} samples" if self.delay else ""
        return f"fitted law {', '.join(parts)}{delay}; R² = {self.r_squared[joint]:.3f}"

    def law(self, signals: JointSignals, torque_limit: Sequence[float] | None = None) -> ControlLaw:
        """Law that follows the references of signals, sampled at `rate`.

        Raises ValueError: a position or velocity gain is not positive: nothing that can be
        simulated.
        """
        kp, kd = self.gain("kp"), self.gain("kd")
        if np.any(kp <= 0.0) or np.any(kd < 0.0):
            raise ValueError("the fitted law has a negative gain")
        velocity, acceleration = _reference_derivatives(signals)
        return ControlLaw(
            kp=kp,
            kd=kd,
            ki=self.gain("ki"),
            velocity_reference=True,
            torque_limit=_values(torque_limit, np.inf, len(kp)),
            period=None,
            delay=self.delay / self.rate,
            feedforward=self.gain("bias")
            + self.gain("reference_velocity") * velocity
            + self.gain("reference_acceleration") * acceleration
            + self.gain("reference_direction") * np.sign(velocity),
        )


def fit_controller(
    signals: JointSignals,
    *,
    cutoff: float | None = None,
    torque_limit: Sequence[float] | None = None,
) -> ControllerFit:
    """Regress the logged torque on what a control law can be made of.

    - `signals`: with a reference; velocities that are missing are central differences
    - `cutoff`: zero-phase low-pass (Butterworth, order 4) of all signals, Hz. Default: a tenth of
      the rate. Noise of the measured errors biases the gains towards zero.
    - `torque_limit`: (n_joints,) Samples at the limit do not follow the law and are left out
    """
    rate, position, torque = signals.rate, signals.position, signals.torque
    assert signals.position_reference is not None
    cutoff = rate / 10.0 if cutoff is None else cutoff
    sections = scipy.signal.butter(4, cutoff, fs=rate, output="sos")
    dq = signals.velocity
    if dq is None:
        dq = np.gradient(position, 1.0 / rate, axis=0)
    reference_dq, reference_ddq = _reference_derivatives(signals)
    error = signals.position_reference - position
    columns = {
        "kp": error,
        "kd": reference_dq - dq,
        "ki": np.cumsum(error, axis=0) / rate,
        "reference_velocity": reference_dq,
        "reference_acceleration": reference_ddq,
        "reference_direction": np.sign(reference_dq),
        "torque": torque,
    }
    smooth = {
        term: np.asarray(scipy.signal.sosfiltfilt(sections, column, axis=0))
        for term, column in columns.items()
    } | {"bias": np.ones_like(position)}
    terms = (*LAW, *CANDIDATES)
    stack, target = np.stack([smooth[term] for term in terms], axis=2), smooth["torque"]
    edge = min(int(np.ceil(2.0 * rate / cutoff)), len(position) // 10) + LONGEST_DELAY
    inside = np.zeros(len(position), dtype=bool)
    inside[edge : len(position) - edge] = True
    joints = position.shape[1]
    rows = np.repeat(inside[:, None], joints, axis=1)
    if torque_limit is not None:
        rows &= np.abs(torque) < 0.99 * np.asarray(torque_limit)
    delay = _delay(stack, target, rows)
    stack = np.roll(stack, delay, axis=0)
    fits = [_fit_joint(stack[rows[:, j], j], target[rows[:, j], j]) for j in range(joints)]
    gains, std, included, r_squared = (np.array(values) for values in zip(*fits, strict=True))
    return ControllerFit(terms, gains, std, included, r_squared, delay, rate, cutoff)


def _reference_derivatives(signals: JointSignals) -> tuple[FloatArray, FloatArray]:
    """Speed and acceleration (n_samples, n_joints) of the references."""
    assert signals.position_reference is not None
    step, velocity = 1.0 / signals.rate, signals.velocity_reference
    if velocity is None:
        velocity = np.gradient(signals.position_reference, step, axis=0)
    return velocity, np.asarray(np.gradient(velocity, step, axis=0))


def _delay(stack: FloatArray, target: FloatArray, rows: NDArray[np.bool_]) -> int:
    """Delay with the least sum of residual energies, relative to those of the torques.

    Every term takes part: what a law without the integral leaves would hide any delay.
    """
    energies = []
    for delay in range(LONGEST_DELAY + 1):
        shifted, total = np.roll(stack, delay, axis=0), 0.0
        for joint in range(target.shape[1]):
            y = target[rows[:, joint], joint]
            _, residual = _least_squares(shifted[rows[:, joint], joint], y)
            total += float(residual @ residual) / max(float(y @ y), 1e-300)
        energies.append(total)
    return int(np.argmin(energies))


def _fit_joint(
    columns: FloatArray, target: FloatArray
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_], float]:
    """Gains, their std, which terms are in, R²; terms are added while one helps clearly."""
    chosen = list(range(len(LAW)))
    solution, residual = _least_squares(columns[:, chosen], target)
    energy = float(residual @ residual)
    while True:
        fits = {}
        for term in set(range(columns.shape[1])) - set(chosen):
            tried = columns[:, [*chosen, term]]
            scaled = tried / np.maximum(np.linalg.norm(tried, axis=0), 1e-300)
            singular = np.linalg.svd(scaled, compute_uv=False)
            if singular[-1] > COLLINEAR * singular[0]:
                fits[term] = _least_squares(tried, target)
        energies = {term: float(left @ left) for term, (_, left) in fits.items()}
        best = min(energies, key=lambda term: energies[term], default=None)
        if best is None or energies[best] > (1.0 - CLEAR_IMPROVEMENT) * energy:
            break
        chosen.append(best)
        (solution, residual), energy = fits[best], energies[best]
    correlation = float(residual[1:] @ residual[:-1]) / max(energy, 1e-300)
    inflation = (1.0 + min(correlation, 0.999)) / max(1.0 - correlation, 1e-3)
    variance = energy / max(len(target) - len(chosen), 1) * max(inflation, 1.0)
    inverse = np.linalg.pinv(columns[:, chosen].T @ columns[:, chosen])
    gains, std = np.zeros(columns.shape[1]), np.zeros(columns.shape[1])
    included = np.zeros(columns.shape[1], dtype=bool)
    gains[chosen], included[chosen] = solution, True
    std[chosen] = np.sqrt(variance * np.diag(inverse))
    spread = float(np.sum((target - target.mean()) ** 2))
    r_squared = 1.0 - energy / spread if spread > 0.0 else 0.0
    return gains, std, included, r_squared


def _least_squares(columns: FloatArray, target: FloatArray) -> tuple[FloatArray, FloatArray]:
    solution = np.linalg.lstsq(columns, target, rcond=None)[0]
    return np.asarray(solution), np.asarray(target - columns @ solution)
