"""One recording of the simulated TX40, identified as sections V.B, V.C and V.D do."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from idim_iv_ros import Configuration, IdentificationResult, identify, load_configuration
from idim_iv_ros.excitation.excite import random_motion
from idim_iv_ros.excitation.trajectory import Trajectory
from idim_iv_ros.simulators.recording import simulate

CONFIG = Path(__file__).resolve().parents[2] / "config" / "tx40.yaml"

APPROPRIATE, INAPPROPRIATE, HUNDRED, EMPTY_BAND, MODEL_ERROR = SITUATIONS = (
    "appropriate",
    "inappropriate",
    "inappropriate-100hz",
    "inappropriate-empty-band",
    "model-error",
)
TITLES = {
    APPROPRIATE: "V.B: appropriate filtering (50 Hz, 20 Hz)",
    INAPPROPRIATE: "V.C: inappropriate filtering (500 Hz, 500 Hz)",
    HUNDRED: "V.C: inappropriate filtering, decimated at 100 Hz",
    EMPTY_BAND: "V.C: inappropriate filtering, decimation filter ending at 0.8 of the Nyquist "
    "frequency as MATLAB's does",
    MODEL_ERROR: "V.D: gravity and off-diagonal inertias left out (50 Hz, 20 Hz)",
}
CUTOFFS = {
    APPROPRIATE: (50.0, 20.0),
    INAPPROPRIATE: (500.0, 500.0),
    HUNDRED: (500.0, 100.0),
    EMPTY_BAND: (500.0, 500.0),
    MODEL_ERROR: (50.0, 20.0),
}
# First moments carry gravity; the rest are the off-diagonal inertias.
LEFT_OUT = [f"{kind}{joint}" for joint in range(2, 7) for kind in ("XY", "XZ", "YZ", "MX", "MY")]

# The peak speeds come out as those of a real record of this robot: 5, 5, 7, 7, 6, 12 rad/s.
PERIOD, REPEATS, MOTION_SEED = 5.0, 2, 1


@dataclass(frozen=True)
class Reproduction:
    """One noise seed.

    Attributes
    ----------
    seed : int
    truth : dict
        Base parameters of the simulated robot by name.
    results : dict
        Situation to what `identify` found.
    """

    seed: int
    truth: dict[str, float]
    results: dict[str, IdentificationResult]


def motion(configuration: Configuration) -> Trajectory:
    """The random exciting motion, 10 s at 5 kHz; its seed is the first that was tried."""
    assert configuration.controller.period is not None
    period = random_motion(
        configuration,
        duration=PERIOD,
        rate=1.0 / configuration.controller.period,
        seed=MOTION_SEED,
    )
    once = (period.position, period.velocity, period.acceleration)
    position, velocity, acceleration = (
        np.vstack([*[signal[:-1]] * (REPEATS - 1), signal]) for signal in once
    )
    return Trajectory(period.joints, period.rate, position, velocity, acceleration)


def situation(configuration: Configuration, name: str) -> Configuration:
    """The configuration of one of `SITUATIONS`."""
    position, decimation = CUTOFFS[name]
    changes = {"position_cutoff": position, "decimation_cutoff": decimation}
    if name == EMPTY_BAND:
        changes["decimation_edge"] = 0.8
    left_out = LEFT_OUT if name == MODEL_ERROR else []
    return configuration.changed("processing", **changes).changed(
        "identification", exclude=left_out
    )


def reproduce(
    seed: int, folder: Path, *, say: Callable[[str], None] = lambda text: None
) -> Reproduction:
    """Simulate and identify; the bag is kept in `folder`."""
    configuration = load_configuration(CONFIG)
    bag = folder / f"tx40-{seed}.mcap"
    _, truth = simulate(configuration, bag, motion(configuration), seeds=[seed])
    results = {}
    for name in SITUATIONS:
        say(f"seed {seed}: {TITLES[name]}")
        results[name] = identify([bag], situation(configuration, name))
    return Reproduction(seed, _read(truth), results)


def _read(path: Path) -> dict[str, float]:
    values: dict[str, float] = json.loads(path.read_text(encoding="utf-8"))
    return values
