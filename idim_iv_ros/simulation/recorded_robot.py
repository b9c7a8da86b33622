"""What a recorder on a simulated robot would write down."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from idim_iv_ros.effects.control_law import ControlLaw
from idim_iv_ros.model import DynamicParameters, RobotModel
from idim_iv_ros.simulation.closed_loop import PLANT_STEP, ClosedLoopResult, simulate_closed_loop
from idim_iv_ros.simulation.effects import SimulatedEffect
from idim_iv_ros.types import FloatArray

# Each kind of noise has a stream of its own, so that one more does not change the others.
_DISTURBANCE, _JITTER = 1, 2


@dataclass(frozen=True)
class SimulatedRecording:
    """Signals (n_samples, n_joints) as recorded, and the same without noise."""

    rate: float  # Hz
    # (n_samples,): stamps, s, from about 0; with jitter they are not when the samples were taken
    time: FloatArray
    position: FloatArray  # rad or m, with encoder resolution and noise
    # N m or N, with noise: mean of the torque command over the sample period centred on the stamp.
    # A command held from a stamp to the next, taken as the torque *at* the stamp, would lead the
    # motion by half a period.
    effort: FloatArray
    position_reference: FloatArray  # rad (m)
    velocity_reference: FloatArray | None  # rad/s (m/s)
    truth: ClosedLoopResult  # At the instants of the control, `control_ratio` for each sample
    control_ratio: int


def record_simulated_robot(
    robot: RobotModel,
    parameters: DynamicParameters,
    law: ControlLaw,
    position_reference: FloatArray,
    velocity_reference: FloatArray | None = None,
    *,
    rate: float,
    seed: int,
    position_noise: float | FloatArray = 0.0,
    torque_noise: float | FloatArray = 0.0,
    encoder_resolution: float | FloatArray = 0.0,
    disturbance: float | FloatArray = 0.0,
    disturbance_bandwidth: float = 10.0,
    stamp_jitter: float = 0.0,
    plant_oversampling: int = 4,
    effects: Sequence[SimulatedEffect] | None = None,
    start_time: float = 0.0,
) -> SimulatedRecording:
    """Simulate a robot from rest on its reference, and record it.

    - `robot`, `parameters`, `law`: the robot as it really is. The control sees the motion without
      noise; noise and quantisation are those of the recorder.
    - `position_reference`, `velocity_reference`: (n_samples, n_joints) at `rate`, rad, rad/s
    - `rate`: of the recording, Hz. The law's period must be a whole fraction of 1/rate.
    - `position_noise`, `torque_noise`: standard deviation, one value or (n_joints,), rad (m), N m
      (N)
    - `encoder_resolution`: step of the recorded position, one value or (n_joints,), rad (m); 0 for
      none
    - `disturbance`: standard deviation of a torque on the joints that is not commanded, so that no
      model explains it, one value or (n_joints,), N m (N)
    - `disturbance_bandwidth`: cut-off of its first-order low-pass, Hz
    - `stamp_jitter`: standard deviation of the stamps, s, held below 0.45 sample periods so that
      their order stays
    - `plant_oversampling`: plant steps in a control period (more where they would exceed 0.5 ms)
    - `effects`, `start_time`: see `simulate_closed_loop`; what is recorded is what the encoders
      show

    Raises ValueError: the control period does not divide the sample period.
    """
    period = 1.0 / rate if law.period is None else law.period
    ratio = round(1.0 / (rate * period))
    if ratio < 1 or abs(ratio * period * rate - 1.0) > 1e-9:
        raise ValueError(f"a control period of {period:g} s does not divide 1/{rate:g} s")
    fine_position = _refined(position_reference, ratio)
    fine_velocity, start_velocity = None, np.zeros(position_reference.shape[1])
    if velocity_reference is not None:
        fine_velocity = _refined(velocity_reference, ratio)
        start_velocity = velocity_reference[0]
    if law.feedforward is not None and ratio > 1:
        law = replace(law, feedforward=_refined(law.feedforward, ratio))
    steps = max(plant_oversampling, math.ceil(period / PLANT_STEP - 1e-6))
    drift = None
    if np.any(np.asarray(disturbance) > 0.0):
        random = np.random.default_rng([seed, _DISTURBANCE])
        white = random.normal(size=(len(fine_position) + 1, position_reference.shape[1]))
        # First-order noise of unit variance from its first sample on.
        pole = math.exp(-2.0 * math.pi * disturbance_bandwidth / (rate * ratio))
        gain, before = math.sqrt(1.0 - pole**2), pole * white[:1]
        noise, _ = scipy.signal.lfilter([gain], [1.0, -pole], white[1:], axis=0, zi=before)
        drift = noise * disturbance
    truth = simulate_closed_loop(
        robot,
        parameters,
        law,
        rate=rate * ratio,
        position_reference=fine_position,
        velocity_reference=fine_velocity,
        initial_position=position_reference[0],
        initial_velocity=start_velocity,
        disturbance=drift,
        plant_step=period / steps,
        effects=effects,
        start_time=start_time,
    )
    rng = np.random.default_rng(seed)
    position = truth.measured_position[::ratio].copy()
    samples = len(position)
    position += rng.normal(size=position.shape) * position_noise
    step = np.broadcast_to(np.asarray(encoder_resolution, dtype=float), position.shape)
    coarse = step > 0.0
    position[coarse] = np.round(position[coarse] / step[coarse]) * step[coarse]
    # Mean of a command over the period about every sample: it acts from its control instant to the
    # next, and the first one before it, too. Half a period is ratio/2 control periods.
    weights = np.ones(ratio) if ratio % 2 == 0 else np.r_[0.5, np.ones(ratio - 1), 0.5]
    mean = scipy.ndimage.correlate1d(truth.torque, weights / ratio, axis=0, mode="nearest")
    effort = mean[::ratio][:samples]
    effort = effort + rng.normal(size=effort.shape) * torque_noise
    jitter = np.random.default_rng([seed, _JITTER]).normal(size=samples) * stamp_jitter
    return SimulatedRecording(
        rate=rate,
        time=np.arange(samples) / rate + np.clip(jitter, -0.45 / rate, 0.45 / rate),
        position=position,
        effort=effort,
        position_reference=position_reference[:samples],
        velocity_reference=None if velocity_reference is None else velocity_reference[:samples],
        truth=truth,
        control_ratio=ratio,
    )


def _refined(signal: FloatArray, ratio: int) -> FloatArray:
    """Linear interpolation at `ratio` points for each sample, (ratio (n - 1) + 1, n_joints)."""
    samples = np.arange(len(signal))
    place = np.arange(ratio * (len(signal) - 1) + 1) / ratio
    return np.column_stack([np.interp(place, samples, column) for column in signal.T])
