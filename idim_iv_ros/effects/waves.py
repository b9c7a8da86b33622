"""Sums of waves over a joint's position, for ripple and for friction that depends on position."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from idim_iv_ros.compilation import kernel
from idim_iv_ros.effects.cause import ParameterSpec
from idim_iv_ros.effects.effect import JointRange, Place, Shape, StructuralEffect
from idim_iv_ros.effects.motion import RobotMotion, Torques
from idim_iv_ros.types import FloatArray

_FINEST = 2.0  # steps of the grid in one period of resolution, 2π / range
_MOST = 400
_HIGHEST = 250.0  # 1/rad: finer than the teeth of a gear; 2500 1/m: than the pitch of a screw
_MOST_TURNED = 64  # waves, each computed from the one before it


@dataclass(frozen=True)
class Waves(Shape):
    """Wave numbers n_k of a sum of waves over the position, 1/rad (1/m)."""

    wave_numbers: tuple[float, ...]


def wave_specs(of: str) -> tuple[ParameterSpec, ...]:
    """Parameters of a sum of waves; `of`: what it is a sum of, in words."""
    return (
        ParameterSpec("wave_number_k", "1/rad", "wave number", default=None),
        ParameterSpec("sine_k", "N m", f"{of} with the sine"),
        ParameterSpec("cosine_k", "N m", f"{of} with the cosine"),
    )


@kernel
def wave(p: FloatArray, position: float) -> float:
    """Value of a wave at a position, compiled, from p = (wave number, sine, cosine)."""
    phase = p[0] * position
    return float(p[1] * math.sin(phase) + p[2] * math.cos(phase))


def _apart(shape: Waves, resolution: float) -> bool:
    """Whether all wave numbers differ by the resolution, 1/rad (1/m), at least."""
    return bool(np.all(np.diff(sorted(shape.wave_numbers)) >= resolution))


def wave_columns(position: FloatArray, shapes: Sequence[Waves]) -> list[FloatArray]:
    """Sine and cosine (s, 2 k) of the k waves of every shape, of all shapes at once.

    Where wave numbers are evenly spaced, each wave is the one before it turned by the same angle,
    which is much less work than a sine and loses no more than a digit over a few dozen of them.
    """
    numbers = np.array([number for shape in shapes for number in shape.wave_numbers])
    lines = np.empty((2 * len(numbers), len(position)))
    several = 3 < len(numbers) <= _MOST_TURNED
    even = np.linspace(numbers[0], numbers[-1], len(numbers)) if several else numbers
    if several and np.max(np.abs(numbers - even)) <= 1e-13 * np.max(np.abs(numbers)):
        wave = np.exp(1j * numbers[0] * position)
        turn = np.exp(1j * (numbers[-1] - numbers[0]) / (len(numbers) - 1) * position)
        for k in range(0, len(lines), 2):
            lines[k], lines[k + 1] = wave.imag, wave.real
            wave *= turn
    else:
        phases = np.multiply.outer(numbers, position)
        np.sin(phases, out=lines[::2])
        np.cos(phases, out=lines[1::2])
    ends = np.cumsum([2 * len(shape.wave_numbers) for shape in shapes])
    return [part.T for part in np.split(lines, ends[:-1])]


class WaveEffect(StructuralEffect[Any]):
    """Base of an effect whose torque is a sum of waves over the position of its joint."""

    linear = ("sine_k", "cosine_k")
    periods: ClassVar[float] = 1.5  # Waves in the range of the joint, at least: fewer are a spring
    # Wave number, 1/rad (1/lever), at least: lower ones are gravity or an encoder off its axis.
    lowest: ClassVar[float] = 2.5

    def grid(self, covered: JointRange) -> list[Any]:
        """Shapes with a single wave.

        The finest is what the slowest motion that counts shows below the rows' Nyquist frequency.
        """
        span = covered.span
        if span <= 0.0:
            return []
        low = max(self.periods * 2.0 * np.pi / span, self.lowest / covered.lever)
        visible = np.pi * covered.row_rate / max(3.0 * covered.slowest, 1e-6)
        high = min(_HIGHEST / covered.lever, max(visible, low))
        step = max(2.0 * np.pi / span / _FINEST, (high - low) / _MOST)
        return [Waves((float(number),)) for number in np.arange(low, high, step)]

    def neighbours(self, shape: Any, step: float, covered: JointRange) -> list[Any]:
        """Each wave number a little higher and lower, by a share of the resolution 2π / span."""
        resolution = 2.0 * np.pi / covered.span
        numbers = shape.wave_numbers
        near = [
            Waves((*numbers[:k], max(number + way * step * resolution, 1e-3), *numbers[k + 1 :]))
            for k, number in enumerate(numbers)
            for way in (1.0, -1.0)
        ]
        return [neighbour for neighbour in near if _apart(neighbour, resolution)]

    def longer(self, shape: Any, covered: JointRange) -> list[Any]:
        """Shapes with a further wave.

        Waves nearer to each other than the resolution are a beat, whose amplitudes may be anything.
        """
        longer = super().longer(shape, covered)
        if len(longer) < 2:
            return []
        first, second = (shape.wave_numbers[-1] for shape in longer[:2])
        return [shape for shape in longer if _apart(shape, _FINEST * (second - first))]

    def torques(self, motion: RobotMotion, place: Place, shapes: Sequence[Any]) -> list[Torques]:
        """Sine and cosine of all waves of every shape, computed at once."""
        made = wave_columns(motion.position[:, place.joint], shapes)
        return [{place.joint: columns} for columns in made]
