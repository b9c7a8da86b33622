"""The cells: a robot, its friction, the nominal model, and how the robot differs from it."""

from dataclasses import dataclass

HAND = (0.66, (0.01, 0.005, 0.06))  # kg and m, a part of the URDF that is not mounted


@dataclass(frozen=True)
class Cell:
    """One robot with a known difference from its nominal model.

    Attributes
    ----------
    arm : str
        A configuration of config/.
    plant : str
        "own": the project's simulation; "mujoco": `mj_step`, a held command, a filtered speed.
    friction : str
        "none", "load" (0.08 to 0.1 of the load at two joints) or "stribeck" (at one joint).
    nominal : str
        "fitted": identified from recordings of the robot without a load, as a user would (rigid,
        viscous, Coulomb); "urdf": every inertial off by 10 %.
    mass : float
        At the flange, kg.
    hand : bool
        Whether the nominal model has a hand of 0.66 kg that is not mounted.
    gain : (int, float) or None
        Joint, from 0, whose recorded torque is this many times the true one.
    tilt : float
        Of gravity about the base's x axis, rad.
    gains : float
        Spread of the gains of all drives, which the user does not know.
    loaded : tuple of bool
        Which recordings have the mass.
    """

    arm: str
    plant: str
    friction: str
    nominal: str
    mass: float
    hand: bool = False
    gain: tuple[int, float] | None = None
    tilt: float = 0.0
    gains: float = 0.0
    loaded: tuple[bool, ...] = (True, True)

    @property
    def name(self) -> str:
        """Unique, for files."""
        parts = [self.arm, self.plant, self.friction, self.nominal, f"{self.mass:g}kg"]
        parts += ["hand"] if self.hand else []
        parts += [f"gain{self.gain[0] + 1}"] if self.gain else []
        parts += ["tilt"] if self.tilt else []
        parts += ["gains"] if self.gains else []
        parts += ["mixed"] if not all(self.loaded) else []
        return "-".join(parts)

    @property
    def truth(self) -> float:
        """Mass that the robot has beyond the nominal model, kg."""
        return self.mass - (HAND[0] if self.hand else 0.0)


def _fitted(arm: str, plant: str, friction: str, *masses: float) -> list[Cell]:
    return [Cell(arm, plant, friction, "fitted", mass) for mass in masses]


CELLS = (
    *_fitted("arm6", "own", "load", 0.0, 0.5, 1.0, 3.0),
    *_fitted("arm6", "own", "stribeck", 0.0, 0.5, 1.5, 3.0),
    *_fitted("arm6", "own", "none", 1.0),
    *_fitted("arm7", "own", "load", 0.0, 1.0, 2.0),
    *_fitted("arm7", "own", "stribeck", 0.0, 0.7, 2.0),
    *_fitted("arm2", "own", "load", 0.0, 0.5, 1.5),
    *_fitted("arm2", "own", "stribeck", 0.0, 0.5, 1.5),
    *_fitted("arm6", "mujoco", "load", 0.0, 1.5),
    *_fitted("arm6", "mujoco", "stribeck", 0.0, 1.5),
    *_fitted("arm7", "mujoco", "load", 2.0),
    *_fitted("arm7", "mujoco", "stribeck", 1.0),
    Cell("arm6", "own", "load", "urdf", 1.5),
    Cell("arm6", "own", "stribeck", "urdf", 2.5),
    Cell("arm7", "own", "load", "urdf", 2.0),
    Cell("arm6", "mujoco", "load", "urdf", 1.5),
    Cell("arm7", "mujoco", "stribeck", "urdf", 2.0),
    Cell("arm7", "own", "none", "fitted", 0.0, hand=True),
    Cell("arm7", "own", "load", "fitted", 0.0, hand=True),
    Cell("arm7", "own", "none", "urdf", 0.0, hand=True),
    Cell("arm6", "mujoco", "stribeck", "fitted", 0.0, hand=True),
    Cell("arm6", "own", "none", "fitted", 0.0, gain=(3, 1.15)),
    Cell("arm6", "own", "load", "fitted", 1.5, gain=(1, 1.15)),
    Cell("arm6", "own", "none", "fitted", 0.0, tilt=0.05),
    Cell("arm6", "own", "load", "fitted", 1.5, tilt=0.05),
    Cell("arm6", "own", "load", "fitted", 2.0, gains=0.2),
    Cell("arm7", "own", "stribeck", "fitted", 2.0, gains=0.2),
    Cell("arm6", "own", "load", "fitted", 1.5, loaded=(False, True)),
    Cell("arm6", "own", "stribeck", "fitted", 1.5, loaded=(True, False)),
)
