"""What `physical` of result.json and gap.json holds."""

from dataclasses import dataclass, field
from typing import Literal

from idim_iv_ros.documents import Matrix, Number
from idim_iv_ros.statistics.hypothesis import HypothesisTest

# Where the value of a standard parameter comes from: the recording shows it alone; the recording
# shows only a sum that it belongs to, which the nominal model splits; or no motion shows it.
Source = Literal["recording", "recording and nominal model", "nominal model"]


@dataclass(frozen=True)
class StandardValue:
    """A standard parameter of the physically consistent set.

    - `std`: of `value`, to first order; None where the nominal model has a part in it, for how it
      splits a sum has no known error
    - `given`: of the nominal model
    """

    name: str
    unit: str
    value: Number
    std: float | None
    given: Number
    source: Source


@dataclass(frozen=True)
class LinkInertia:
    """The body that one joint carries, with all that is fixed to it.

    - `smallest_before`, `smallest_after`, `bound`: smallest eigenvalue of the pseudo-inertia
      relative to the nominal one (1: the nominal link; below zero: no body has it): of the
      estimate, split as the nominal model splits it; of the consistent set; and the least that the
      set may have
    - `eigenvalues`: (4,), of the pseudo-inertia of the consistent set, lengths in units of the
      link's nominal radius of gyration, in kg, ascending
    - `active`: whether the bound holds the link back
    """

    joint: str
    smallest_before: Number
    smallest_after: Number
    bound: Number
    eigenvalues: tuple[Number, ...]
    active: bool


@dataclass(frozen=True)
class BaseChange:
    """A base parameter: estimate, consistent value, and their difference in σ of the estimate."""

    name: str
    estimate: Number
    std: Number
    value: Number
    deviations: Number


@dataclass(frozen=True)
class TorqueError:
    """Relative error of the torque of estimate and consistent set, %.

    Joints count by the inverse of their residual's variance, so that none hides another.

    - `before`, `after`: on all rows
    - `held_out_before`, `held_out_after`: fitted without each quarter of the recording in turn, and
      judged there; None where a quarter is needed to see all parameters
    """

    before: Number
    after: Number
    held_out_before: float | None
    held_out_after: float | None


@dataclass(frozen=True, kw_only=True)
class PhysicalParameters:
    """The physically consistent parameters nearest to the estimate.

    - `test`: d² = ‖R(Kπ − β̂)‖² against χ² of as many degrees of freedom as base parameters that
      are shown: conservative, since most directions are free of bounds
    - `sentence`: in words: whether a robot with such parameters could have made the recording
    - `active`: bounds that hold the set back: joints of links, names of drive and friction
      parameters
    - `shared`: friction parameters without a bound: an effect at the same joint shares them, and
      only the sum takes energy
    - `covariance`: (b, b), of the estimates in `base`, in their order and the products of their
      units; rows of zeros are not shown by the recording. None in documents of before.
    """

    test: HypothesisTest
    sentence: str
    parameters: tuple[StandardValue, ...]
    links: tuple[LinkInertia, ...]
    base: tuple[BaseChange, ...]
    active: tuple[str, ...]
    shared: tuple[str, ...] = ()
    torque_error: TorqueError | None
    seconds: Number
    covariance: Matrix | None = field(default=None, compare=False)

    @property
    def values(self) -> dict[str, float]:
        """Values of the standard parameters by name."""
        return {parameter.name: parameter.value for parameter in self.parameters}
