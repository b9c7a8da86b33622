"""An effect with its shape drawn and its strength still open."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.withheld_effects.drive import altered
from benchmarks.withheld_effects.robot import GivenRobot
from benchmarks.withheld_effects.world import World, with_drive


@dataclass(frozen=True)
class Effect:
    """One cause of a gap at one joint (or None: of the whole robot).

    Attributes
    ----------
    name : str
        As in gap.json, or the name of something outside the catalogue.
    joint : int or None
        From 0; for a coupling the second of the two.
    apply : callable
        World and strength to the world with the effect; strength 0 changes nothing that matters.
    usual : float
        Strength that shows a ratio of about one; where the calibration starts.
    largest : float
        Beyond it the effect is implausible or the loop unstable.
    shape : dict
        What was drawn, for the label.
    joints : tuple of int
        Joints at which the effect is seen; the calibration looks at the first.
    measure : "refit", "given" or "command"
        Of which residual rho is defined: of the best rigid model, of the nominal model, of the
        control law.
    whole_session : bool
        Repeats do not weigh alike, so that the calibration needs every recording.
    """

    name: str
    joint: int | None
    apply: Callable[[World, float], World]
    usual: float
    largest: float
    shape: dict[str, float | str] = field(default_factory=dict)
    joints: tuple[int, ...] = ()
    measure: str = "refit"
    whole_session: bool = False

    @property
    def seen_at(self) -> int:
        """Joint at which the strength is calibrated, from 0."""
        if self.joints:
            return self.joints[0]
        return 0 if self.joint is None else self.joint


def on_drive(
    joint: int, values: Callable[[float], dict[str, Any]]
) -> Callable[[World, float], World]:
    """An `apply` that gives the drive of one joint other values of `Drive`, by the strength."""
    return lambda world, strength: with_drive(
        world, altered(world.drive, joint, **values(strength))
    )


Draw = Callable[[np.random.Generator, GivenRobot, int], Effect]
