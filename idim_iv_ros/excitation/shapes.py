"""Building blocks of motions that start and end at rest, relative to where they start.

Each function returns position, velocity and acceleration, (n_samples, n_joints) each, sampled at
0, 1/rate, … up to but without the end, where the next block begins.
"""

import numpy as np

from idim_iv_ros.types import FloatArray

Shape = tuple[FloatArray, FloatArray, FloatArray]


def rest_to_rest(displacement: FloatArray, seconds: float, rate: float) -> Shape:
    """Quintic from rest to rest: peaks 1.875 d/T in velocity, 5.774 d/T² in acceleration."""
    s, seconds = _phase(seconds, rate)
    position = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    velocity = 30.0 * s**2 * (1.0 - s) ** 2 / seconds
    acceleration = 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / seconds**2
    return position * displacement, velocity * displacement, acceleration * displacement


def there_and_back(speed: FloatArray, plateau: float, ramp: float, rate: float) -> Shape:
    """Constant speed for `plateau` s, and the same way back.

    The speed rises and falls within `ramp` s as 3s² - 2s³, so that the acceleration is
    continuous, zero at both ends, and 1.5 speed / ramp at most. Reaches speed · (plateau + ramp).
    """
    rise, ramp = _phase(ramp, rate)
    flat = np.zeros((max(round(plateau * rate), 1), 1))
    level = np.vstack([3 * rise**2 - 2 * rise**3, flat + 1.0, 1.0 - 3 * rise**2 + 2 * rise**3])
    slope = 6.0 * rise * (1.0 - rise) / ramp
    slope = np.vstack([slope, flat, -slope])
    up = ramp * (rise**3 - 0.5 * rise**4)
    middle = 0.5 * ramp + np.arange(len(flat))[:, None] / rate
    top = 0.5 * ramp + len(flat) / rate
    way = np.vstack([up, middle, top + ramp * (rise - rise**3 + 0.5 * rise**4)])
    reach = top + 0.5 * ramp
    way, level = np.vstack([way, reach - way]), np.vstack([level, -level])
    return way * speed, level * speed, np.vstack([slope, -slope]) * speed


def waves(
    amplitude: FloatArray,
    frequency: FloatArray,
    phase: FloatArray,
    seconds: float,
    fade: float,
    rate: float,
) -> Shape:
    """Sum of sines of (n_lines, n_joints) each, faded in and out over `fade` s (quintic)."""
    s, seconds = _phase(seconds, rate)
    time = s * seconds
    position, velocity, acceleration = np.zeros((3, len(s), amplitude.shape[1]))
    for a, f, p in zip(amplitude, frequency, phase, strict=True):
        pulsation = 2.0 * np.pi * f
        position += a * np.sin(pulsation * time + p)
        velocity += a * pulsation * np.cos(pulsation * time + p)
        acceleration -= a * pulsation**2 * np.sin(pulsation * time + p)
    distance = np.minimum(time, seconds - time)
    u = np.clip(distance / fade, 0.0, 1.0)
    side = np.where(time <= seconds / 2.0, 1.0, -1.0) / fade
    window = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    first = side * 30.0 * u**2 * (1.0 - u) ** 2
    second = 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / fade**2
    return (
        window * position,
        window * velocity + first * position,
        window * acceleration + 2.0 * first * velocity + second * position,
    )


def _phase(seconds: float, rate: float) -> tuple[FloatArray, float]:
    """Progress from 0 up to but without 1, (n_samples, 1), and the seconds it really takes."""
    samples = max(int(np.ceil(seconds * rate - 1e-6)), 2)
    return np.arange(samples)[:, None] / samples, samples / rate
