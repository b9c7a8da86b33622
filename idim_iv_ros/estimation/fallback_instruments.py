"""Instruments where the loop cannot be simulated; each says what it is and what it costs."""

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from idim_iv_ros.estimation.instruments import Instruments
from idim_iv_ros.estimation.observation import instrument_rows
from idim_iv_ros.model import InverseModel
from idim_iv_ros.signals import Motion, zero_phase_butterworth
from idim_iv_ros.simulation import ReferenceFilter, filter_reference
from idim_iv_ros.types import FloatArray


def reference(motion: Motion) -> FloatArray:
    """Position reference of a motion that has one, rad."""
    if motion.signals.position_reference is None:
        raise ValueError(f"{motion.signals.name} has no reference")
    return motion.signals.position_reference


@dataclass(frozen=True)
class FilteredReference:
    """Instruments from the reference passed through a fitted closed-loop filter.

    Attributes
    ----------
    model : InverseModel
    motions : tuple of Motion
        All with references.
    """

    model: InverseModel
    motions: tuple[Motion, ...]

    @cached_property
    def filters(self) -> tuple[ReferenceFilter, ...]:
        """One for each motion; fitted when they are needed, which a loop that simulates spares."""
        return tuple(
            filter_reference(motion.signals.rate, motion.position, reference(motion))
            for motion in self.motions
        )

    @property
    def name(self) -> str:
        """Name with how closely it follows the recorded motion, that of the worst recording."""
        robot = self.model.robot
        errors = np.max([found.error for found in self.filters], axis=0)
        spreads = np.max([found.spread for found in self.filters], axis=0)
        joints = ", ".join(
            f"{name} {error:.2g} {'rad' if kind == 'revolute' else 'm'}"
            + (f" ({100.0 * error / spread:.2g} %)" if spread > 0.0 else "")
            for name, kind, error, spread in zip(
                robot.joints, robot.joint_types, errors, spreads, strict=True
            )
        )
        return (
            "reference through a fitted closed-loop filter, which misses the recorded motion where "
            f"it was not fitted by (rms, and share of the motion's standard deviation): {joints}"
        )

    @property
    def testable(self) -> str | None:
        """The filter follows the measured motion whatever the dynamic model is."""
        return (
            "the instruments come from a filter that was fitted to the measured motion: it follows "
            "the robot whatever the dynamic model is"
        )

    @property
    def iterative(self) -> bool:
        """The filter does not depend on the parameters."""
        return False

    def prediction_errors(self, values: FloatArray, covariance: FloatArray) -> None:
        """These instruments do not depend on the parameters."""

    def instruments(self, values: FloatArray, reference_values: FloatArray) -> Instruments:
        """Differentiate the filtered references."""
        states = tuple(
            partial(motion.derivatives_of, found.position)
            for found, motion in zip(self.filters, self.motions, strict=True)
        )
        return Instruments(instrument_rows(self.model, self.motions, states), states)


@dataclass(frozen=True)
class SmoothedMeasurement:
    """Instruments from the measurements themselves, smoothed harder than the regressor.

    Noise below the smoothing cut-off stays in both X and Z: it is not averaged out, so that the
    estimate keeps the bias of least squares in that band, and Π = I says nothing.
    """

    model: InverseModel
    motions: tuple[Motion, ...]
    cutoff: float

    @property
    def name(self) -> str:
        """Name with the cut-off."""
        return f"measured positions smoothed at {self.cutoff:.3g} Hz"

    @property
    def testable(self) -> str | None:
        """The instruments are made from the regressor's own measurements."""
        return (
            "the instruments are smoothed measurements, not a simulation: the noise below "
            f"{self.cutoff:.3g} Hz is in both"
        )

    @property
    def iterative(self) -> bool:
        """The measurements do not depend on the parameters."""
        return False

    def prediction_errors(self, values: FloatArray, covariance: FloatArray) -> None:
        """These instruments do not depend on the parameters."""

    def instruments(self, values: FloatArray, reference_values: FloatArray) -> Instruments:
        """Smooth and differentiate."""
        states = []
        for motion in self.motions:
            smooth = zero_phase_butterworth(
                motion.position, rate=motion.signals.rate, cutoff=self.cutoff, order=4
            )
            states.append(partial(motion.derivatives_of, smooth))
        return Instruments(instrument_rows(self.model, self.motions, states), tuple(states))
