"""What a check says of encoders behind the gears, before anything is made of them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.model.parameters import unit_at
from idim_iv_ros.signals import Motion

# A link turns as far as its motor (in joint angles): otherwise another unit, sign or ratio.
_TURNS = 0.1
_STANDS_STILL = 0.01  # of the motor's motion


@dataclass(frozen=True)
class LinkEncoder:
    """One joint's encoder behind the gear.

    `ratio`: how far the link turns beside its motor; `apart`: RMS of their difference, less its
    mean in each recording, rad (m); `unit`: of that.
    """

    joint: str
    ratio: float
    apart: float
    unit: str

    @property
    def problem(self) -> str:
        """What is wrong with it; empty where nothing is."""
        if abs(self.ratio) < _STANDS_STILL:
            return "the encoder behind the gear stands still while the motor turns"
        if abs(self.ratio - 1.0) > _TURNS:
            return (
                f"the encoder behind the gear turns {self.ratio:.3g} times as far as the motor: "
                "look at its unit and sign, and at the gear ratio"
            )
        return ""

    @property
    def sentence(self) -> str:
        """What it shows."""
        return (
            f"an encoder behind the gear: it differs from the motor by {1e3 * self.apart:.3g} "
            f"m{self.unit} rms, twist, play and time offset together; diagnose tells them apart"
        )


def link_encoders(
    motions: Sequence[Motion], joints: Sequence[str], joint_types: Sequence[str]
) -> tuple[LinkEncoder, ...]:
    """Describe every joint that has an encoder behind its gear in all recordings."""
    encoders = []
    for joint, name in enumerate(joints):
        pairs = []
        for motion in motions:
            signals, span = motion.signals, motion.span
            if signals.link_position is None or signals.link_valid is None:
                break
            valid = signals.link_valid[span, joint]
            if not valid.any():
                break
            motor = signals.position[span, joint][valid]
            link = signals.link_position[span, joint][valid]
            pairs.append((motor - motor.mean(), link - link.mean()))
        if len(pairs) < len(motions):
            continue
        motor, link = (np.concatenate(signals_of) for signals_of in zip(*pairs, strict=True))
        energy = float(motor @ motor)
        if energy <= 0.0:
            continue
        encoders.append(
            LinkEncoder(
                joint=name,
                ratio=float(motor @ link) / energy,
                apart=float(np.sqrt(np.mean((motor - link) ** 2))),
                unit=unit_at("rad", joint_types[joint]),
            )
        )
    return tuple(encoders)
