"""What a recording has beside its effects: drawn for every cell, never labelled as an effect."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.withheld_effects.robot import GivenRobot
from benchmarks.withheld_effects.sensors import Sensors

FloatArray = NDArray[np.float64]
CONTROL_RATES = (100.0, 250.0, 500.0, 500.0, 1000.0, 1000.0, 1000.0, 1000.0, 2000.0, 2000.0)  # Hz
SLOWEST_RECORDING = 100.0  # Hz
# Periods (s) from which on the loop needs gains that are softer by a factor.
SOFTER = ((5e-3, 0.3), (1.5e-3, 0.55), (0.0, 1.0))


@dataclass(frozen=True)
class Nuisances:
    """The signal chain, the sensors, the nominal model and the files of one cell.

    Attributes
    ----------
    period : s
        Of the control; the command is held over it.
    record_every : int
        Control periods from one recorded sample to the next.
    computing : s
        From the sample to the command's first instant.
    lateness : s
        Of the law's speed, a filtered difference of the encoder; 0: the drive's own speed.
    effort : str
        ``command``: stamped when it is computed; ``measured``: mean over the period before.
    effort_offset : s
        By which the stamps of the efforts are late; only where they have a topic of their own.
    effort_every : int
        Recorded samples from one effort to the next; with 1 and no offset both share a topic.
    slot : s
        By which each joint is sampled after the one before it.
    jitter : s
        Standard deviation of the stamps.
    bits : float
        Of the encoders, over one turn of the joint.
    encoder_noise, torque_noise : float
        Shares of a count and of the torque limit.
    gain : tuple of float or None
        N m/A of each joint where efforts are currents.
    ripple : float
        Of that gain, relative; `ripple_orders` waves per rad.
    warm_dry, warm_viscous, warm_time
        Drift of the friction, shares and s.
    publishes_velocity, has_reference, knows_controller, knows_period : bool
    repeats : bool
        One motion comes twice.
    softer : float
        Factor on kp and kd, which the configuration knows.
    nominal_error : float
        Largest relative error of the nominal model's inertials; the least is 0.05 or this.
    knows_armature : bool
    part : float
        Share of the last link's mass that the nominal model lacks (> 0) or has too much (< 0).
    knows_friction : bool
        Whether the URDF gives friction, as most do not.
    """

    period: float
    record_every: int
    computing: float
    lateness: float
    effort: str
    effort_offset: float
    effort_every: int
    slot: float
    jitter: float
    bits: float
    encoder_noise: float
    torque_noise: float
    gain: tuple[float, ...] | None
    ripple: float
    ripple_orders: tuple[float, ...]
    warm_dry: float
    warm_viscous: float
    warm_time: float
    publishes_velocity: bool
    has_reference: bool
    knows_controller: bool
    knows_period: bool
    repeats: bool
    softer: float
    nominal_error: float
    knows_armature: bool
    part: float
    knows_friction: bool

    def document(self) -> dict[str, Any]:
        """For the label."""
        return asdict(self)

    @property
    def separate_topic(self) -> bool:
        """Whether efforts have a topic of their own."""
        return self.effort_every > 1 or self.effort_offset != 0.0

    def sensors(self, given: GivenRobot) -> Sensors:
        """Noise of the recording, for the plants."""
        n = len(given.joints)
        count = 2.0 * np.pi / 2.0**self.bits
        return Sensors(
            position=np.full(n, self.encoder_noise * count),
            velocity=np.full(n, 5e-4),
            torque=self.torque_noise * given.effort,
            resolution=np.full(n, count),
            colour=0.0,
            jitter=self.jitter,
            dropout=np.zeros(n),
        )


def drawn(
    rng: np.random.Generator, given: GivenRobot, *, identified: bool, needs_law: bool = False
) -> Nuisances:
    """Draw the nuisances of one cell.

    Parameters
    ----------
    identified
        The nominal model was fitted to the robot: its inertials are within 0.2 percent and
        nothing is missing in it, so that one wrong number can be told.
    needs_law
        The configuration knows the control law, without which its effect cannot be seen.
    """
    n = len(given.joints)
    period = 1.0 / rng.choice(CONTROL_RATES)
    most = max(1, int(1.0 / (period * SLOWEST_RECORDING)))
    effort_every = int(rng.choice([1, 1, 2]))
    offset = float(rng.uniform(-1e-3, 1e-3)) if rng.random() < 0.4 else 0.0
    current = rng.random() < 0.4
    reference = rng.random() < 0.85 or needs_law
    controller = rng.random() < 0.75 or needs_law
    return Nuisances(
        period=float(period),
        record_every=int(rng.choice([every for every in (1, 1, 2, 4, 10) if every <= most])),
        computing=float(rng.choice([0.0, rng.uniform(0.1, 0.6), 1.0]) * period),
        lateness=float(rng.uniform(0.0, 4e-3)) if rng.random() < 0.7 else 0.0,
        effort=str(rng.choice(["command", "measured"])),
        effort_offset=offset,
        effort_every=effort_every,
        slot=float(rng.uniform(5e-6, 4e-5)) if rng.random() < 0.5 else 0.0,
        jitter=float(rng.uniform(1e-5, 1e-4)) if rng.random() < 0.5 else 0.0,
        bits=float(rng.integers(19, 23)),
        encoder_noise=float(rng.uniform(0.2, 1.0)),
        torque_noise=float(rng.uniform(0.002, 0.007)),
        gain=tuple(map(float, rng.uniform(0.5, 12.0, n))) if current else None,
        ripple=float(rng.uniform(0.003, 0.015)) if current else 0.0,
        ripple_orders=tuple(map(float, rng.uniform(60.0, 400.0, n))),
        warm_dry=float(rng.uniform(0.0, 0.02)),
        warm_viscous=float(rng.uniform(0.0, 0.04)),
        warm_time=float(rng.uniform(8.0, 40.0)),
        publishes_velocity=bool(rng.random() < 0.6),
        has_reference=bool(reference),
        knows_controller=bool(controller and reference),
        knows_period=bool(rng.random() < 0.6),
        repeats=bool(rng.random() < 0.35),
        softer=next(factor for least, factor in SOFTER if period >= least),
        nominal_error=0.002 if identified else float(rng.uniform(0.05, 0.3)),
        knows_armature=bool(identified or rng.random() < 0.8),
        part=_part(rng) if not identified else 0.0,
        knows_friction=bool(identified or rng.random() < 0.7),
    )


def _part(rng: np.random.Generator) -> float:
    return float(rng.choice([0.0, 0.0, 0.0, 0.0, rng.uniform(0.3, 1.5), -rng.uniform(0.3, 0.7)]))
