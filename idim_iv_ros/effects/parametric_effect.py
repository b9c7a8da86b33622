"""What every parametric effect declares: a change of parameters that the nominal model has."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from idim_iv_ros.effects.cause import Cause, EffectParameter, Parameters
from idim_iv_ros.model import InverseModel
from idim_iv_ros.model.base_parameters import NON_NEGATIVE
from idim_iv_ros.model.parameters import INERTIAL
from idim_iv_ros.types import FloatArray

# A negative value counts as such when it lies this many standard deviations below zero.
CLEARLY = 3.0


@dataclass(frozen=True)
class Change:
    """A number of the nominal model that a hypothesis changes."""

    name: str
    unit: str
    direction: FloatArray  # (d,): how the torque answers, in the coordinates of a `ParameterSpace`
    least: float = -np.inf  # Smallest change that physics allows


@dataclass(frozen=True)
class Estimated:
    """Estimate of a change with its standard deviation, beside all others of the hypothesis."""

    change: Change
    value: float
    std: float

    def may_exceed(self, least: float) -> bool:
        """Whether it may lie above `least`."""
        return self.value + CLEARLY * self.std >= least


@dataclass(frozen=True)
class ParameterSpace:
    """Coordinates of all changes: b base parameters, two tilts of gravity, a gain of each joint."""

    model: InverseModel
    given: FloatArray  # (b,): base parameters of the nominal model
    axes: FloatArray  # (2, 3): unit vectors of the base frame about which gravity may be tilted
    # Kind and joint of numbers of which the nominal model says nothing
    not_given: frozenset[tuple[str, int]] = frozenset()
    # Whether numbers are changes from those of other recordings, whatever the nominal model says
    is_free: bool = False

    @property
    def joints(self) -> int:
        """Number of joints of the robot."""
        return len(self.model.robot.joints)

    @property
    def size(self) -> int:
        """Length of a direction: d = b + 2 + n_joints."""
        return len(self.given) + 2 + self.joints

    def change(self, kind: str, joint: int, name: str) -> list[Change]:
        """Return the change of a standard parameter, empty where the torque does not show it.

        What no body, drive or friction has below zero may be taken away whole; of a link, where the
        nominal model gives it.
        """
        parameters = enumerate(self.model.regressor.layout.parameters)
        places = [k for k, of in parameters if (of.kind, of.joint) == (kind, joint)]
        direction = np.zeros(self.size)
        direction[: len(self.given)] = self.model.base.grouping[:, places].sum(axis=1)
        if not direction.any():
            return []
        parameter = self.model.regressor.layout.parameters[places[0]]
        value = self.model.robot.given.value_of(parameter)
        given = 0.0 if value is None else float(value)
        bounded = kind in NON_NEGATIVE and (kind not in INERTIAL or given > 0.0)
        return [Change(name, parameter.unit, direction, -given if bounded else -np.inf)]

    def tilt(self, axis: int) -> FloatArray:
        """Direction (d,) of a rotation of gravity about one of the axes, rad."""
        return np.asarray(np.eye(1, self.size, len(self.given) + axis)[0])

    def gain(self, joint: int) -> FloatArray:
        """Direction (d,) of a relative change of the torque that a joint needs."""
        return np.asarray(np.eye(1, self.size, len(self.given) + 2 + joint)[0])


class ParametricEffect(Cause):
    """A way in which numbers of the nominal model may be wrong.

    The simulator has it with the base parameters, unless it says otherwise.
    """

    kind = "parametric"
    in_base_parameters = True
    # Kinds of standard parameters that may change together, the smallest set first; by default
    # those of all `specs`.
    sets: ClassVar[tuple[tuple[str, ...], ...]] = ()
    # Change from which on a number is of something else: a wrong sign or unit, a large angle.
    largest: ClassVar[float] = np.inf

    def places(self, space: ParameterSpace) -> list[int | None]:
        """Joints at which the numbers may be wrong, by default all; None: no joint by itself."""
        return list(range(space.joints))

    def variants(self, space: ParameterSpace, joint: int | None) -> list[list[Change]]:
        """Numbers that may change together, of each of the `sets` of which the motion shows any."""
        assert joint is not None
        variants: list[list[Change]] = []
        for kinds in self.sets or [[spec.standard for spec in self.specs]]:
            shown = (space.change(kind, joint, self.change_of(kind, joint)) for kind in kinds)
            variants.append([change for changes in shown for change in changes])
        return list(filter(None, variants))

    def change_of(self, kind: str, joint: int) -> str:
        """Return the name of the change of a kind of standard parameter: that of its spec."""
        return next(spec.name for spec in self.specs if spec.standard == kind)

    def is_not_given(self, space: ParameterSpace, joint: int) -> bool:
        """Whether the nominal model says nothing of it at a joint."""
        return any((spec.standard, joint) in space.not_given for spec in self.specs)

    def inseparable_from(self, space: ParameterSpace, joint: int) -> tuple[str, ...]:
        """Effects at the joint that share its base parameters."""
        return ()

    def which(self, joint: int) -> str:
        """More words for its place: of a link its number; empty by default."""
        return ""

    def admissible(
        self, space: ParameterSpace, joint: int | None, estimates: Sequence[Estimated]
    ) -> bool:
        """Whether physics allows the estimate: changes up to `largest`, none clearly too small."""
        return all(
            abs(estimate.value) <= self.largest and estimate.may_exceed(estimate.change.least)
            for estimate in estimates
        )

    def parameters(self, estimates: Sequence[Estimated]) -> Parameters:
        """Return the numbers by the names of the changes."""
        return {
            one.change.name: EffectParameter(float(one.value), one.std, one.change.unit)
            for one in estimates
        }
