"""Sizes that an effect has on arms: one that shows only when it is larger is not testable."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.gap.baseline import Baseline
from idim_iv_ros.gap.candidate_rows import extent
from idim_iv_ros.gap.effects.effect import Effect, Extent, Shape
from idim_iv_ros.gap.result import EffectParameter

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Plausible:
    """Size of an effect that a recording should be able to show.

    Attributes
    ----------
    limit : float
    of : str
        ``dry``: its largest torque over the joint's dry friction; ``peak``: over the largest
        torque; ``size``: its largest coefficient; else the parameter with this name, in its unit.
    """

    limit: float
    of: str


# The middle (geometric) of what is typical of arms: an effect of which only larger sizes would be
# seen may well be there without a trace.
PLAUSIBLE: dict[str, Plausible] = {
    "stribeck": Plausible(0.2, "dry"),  # static over dry friction 1.05 to 1.6
    "nonlinear_viscous": Plausible(0.5, "dry"),
    "asymmetric_friction": Plausible(0.1, "dry"),  # 5 to 20 %
    "load_dependent_friction": Plausible(0.1, "driving"),  # 3 to 40 %
    "position_dependent_friction": Plausible(0.1, "dry"),  # 5 to 15 %
    "friction_drift": Plausible(0.4, "dry"),  # 30 to 60 %
    "presliding": Plausible(0.5, "dry"),
    "backlash": Plausible(0.001, "gap"),  # 0.1 to 10 mrad; 0.01 to 1 mm
    "time_delay": Plausible(0.002, "delay"),  # 0.25 to 20 ms
    "torque_saturation": Plausible(0.05, "peak"),  # 0 to 15 %
    "position_ripple": Plausible(0.015, "peak"),  # 0.5 to 3 %
    "spring": Plausible(0.1, "peak"),
    "encoder_eccentricity": Plausible(0.002, "size"),  # 0.01 to 5 mrad
    "joint_coupling": Plausible(0.5, "dry"),
}
_SOFTEST = 11.0  # Hz, resonance of the link: 5 to 25 Hz


@dataclass(frozen=True)
class JointScale:
    """What is small and large at one joint.

    Attributes
    ----------
    covered : Extent
        By the recordings, of all joints.
    joint : int
    dry_friction : float
        N m (N).
    """

    covered: Extent
    joint: int
    dry_friction: float

    @property
    def peak(self) -> float:
        """Largest torque, N m (N)."""
        return float(self.covered.torque[self.joint])

    @property
    def least_stiffness(self) -> float:
        """Of a shaft with the softest resonance that is common, N m/rad."""
        return float(self.covered.inertia[self.joint]) * (2.0 * np.pi * _SOFTEST) ** 2


def dry_friction(data: Baseline) -> tuple[float, ...]:
    """Dry friction of each joint from the refit, N m (N); 5 % of the peak where it has none."""
    covered = extent(data)
    levels = data.prepared.model.dynamic_parameters(data.estimate.linear.values).coulomb
    return tuple(
        float(level) if level > 0.01 * peak else 0.05 * float(peak)
        for level, peak in zip(levels, covered.torque, strict=True)
    )


def judged(
    effect: Effect, shape: Shape, coefficients: FloatArray, torque: float, scale: JointScale
) -> tuple[str, bool]:
    """Size in words, and whether it is no larger than what is plausible.

    Parameters
    ----------
    shape, coefficients
        Of the effect; coefficients (k,).
    torque
        The largest that it then adds, N m (N).
    """
    found = effect.parameters(shape, coefficients, np.zeros(len(coefficients)))
    words = _in_words(found, torque)
    if effect.name == "elasticity":
        stiffness = found["stiffness"].value
        return f"stiffness {stiffness:.2g} N m/rad", bool(stiffness >= scale.least_stiffness)
    limit = PLAUSIBLE.get(effect.name)
    if limit is None:
        return words, True
    if limit.of == "dry":
        return words, torque <= limit.limit * scale.dry_friction
    if limit.of == "peak":
        return words, torque <= limit.limit * scale.peak
    if limit.of == "size":
        return words, bool(np.max(np.abs(coefficients)) <= limit.limit)
    value = max(p.value for name, p in found.items() if name in (limit.of, "driven"))
    lever = float(scale.covered.lever[scale.joint]) if limit.of == "gap" else 1.0
    return words, value <= limit.limit * lever


_WORDS: tuple[str, ...] = (
    "gap", "delay", "slope", "driving", "excess", "offset", "height", "sine_1", "cosine_1",
    "level_1", "coulomb", "viscous", "coefficient", "constant", "linear", "quadratic", "cubic",
    "bent", "sine", "cosine", "sine_2", "cosine_2", "driven",
)  # fmt: skip


def _in_words(found: dict[str, EffectParameter], torque: float) -> str:
    """The first parameter that is not zero, with its unit."""
    for name in _WORDS:
        if name in found and found[name].value != 0.0:
            unit = f" {found[name].unit}" if found[name].unit else ""
            plain = found[name].unit == "N m" or torque <= 0.0
            more = "" if plain else f" (up to {torque:.2g} N m)"
            return f"{name.replace('_', ' ')} = {found[name].value:.2g}{unit}{more}"
    return f"{torque:.2g} N m"
