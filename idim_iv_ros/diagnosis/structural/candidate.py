"""An effect at a place with its best shape, and how well it is supported."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.diagnosis.structural.likelihood import Columns, Fit
from idim_iv_ros.effects.effect import Effect, Place, Shape
from idim_iv_ros.types import FloatArray


@dataclass(frozen=True)
class Candidate:
    """An effect at a place with its best shape, beside a model.

    Attributes
    ----------
    effect : Effect
    place : Place
    shape : Shape
    columns : Columns
        Rows (r_j, k) by joint.
    fit : Fit
        With the candidate in the model.
    gain : float
        Of the logarithm of the likelihood, with the colours of `fit`.
    closed : float
        Share of the torque gap's energy at its joints that it takes away, not whitened.
    numbers : int
        Coefficients and shape: what the candidate may choose.
    tried : int
        Shapes on its grid.
    """

    effect: Effect
    place: Place
    shape: Shape
    columns: Columns
    fit: Fit
    gain: float
    closed: float
    numbers: int
    tried: int

    @property
    def coefficients(self) -> FloatArray:
        """Those of this candidate: the last of the fit."""
        return self.fit.coefficients[-self.width :]

    @property
    def width(self) -> int:
        """How many columns it has."""
        return int(next(iter(self.columns.values())).shape[1])

    def share_of_torque(self, sizes: Sequence[float]) -> float:
        """RMS of the gap that it closes at its joint, as a share of that joint's torque `sizes`.

        Not of its own torque: a free curve of the speed holds the dry friction that the model has.
        """
        joint = self.place.joint
        after = float(np.mean(self.fit.residuals[joint] ** 2))
        closed = min(max(self.closed, 0.0), 1.0 - 1e-9)
        return float(np.sqrt(after * closed / (1.0 - closed))) / sizes[joint]

    @property
    def cost(self) -> float:
        """Of its numbers and of the search: what chance would gain, and more (Schwarz)."""
        rows = sum(len(self.fit.residuals[joint]) for joint in self.own_joints)
        return 0.5 * self.numbers * float(np.log(max(rows, 2))) + float(np.log(self.tried))

    @property
    def support(self) -> float:
        """Gain less the cost."""
        return self.gain - self.cost

    @property
    def own_joints(self) -> tuple[int, ...]:
        """The joint of the effect, or both of a coupling."""
        other = self.place.other
        return (self.place.joint,) if other is None else (self.place.joint, other)

    @property
    def key(self) -> tuple[str, int, int | None]:
        """Effect and place."""
        return self.effect.name, self.place.joint, self.place.other
