"""Causes, hints, parameter errors, what is left unexplained, and how well each is supported."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from idim_iv_ros.documents import Number
from idim_iv_ros.effects.cause import EffectParameter, Family, Kind

LEAST_ROOM = 1e-3  # of a gap, above the noise floor, for a shrinkage to be said


@dataclass(frozen=True)
class Evidence:
    """Why an effect is believed.

    - `statistic`: twice the logarithm of the likelihood ratio, of whitened residuals, with and
      without (structural); Wald statistic of the change of the parameters (parametric)
    - `held_out_gain`: share of the energy of the whitened residual that the effect removes, on
      blocks not used to fit; None where there are no such blocks
    - `folds_positive`: on how many of the held-out blocks the effect helps: ``5 of 6``
    - `chosen_in_folds`: without how many of the folds a search names it again: ``5 of 5``; empty of
      causes that no search selects
    """

    statistic: Number
    held_out_gain: float | None = None
    folds_positive: str = ""
    chosen_in_folds: str = ""


@dataclass(frozen=True)
class Indistinguishable:
    """An effect that explains the recording nearly as well as the accepted one.

    `weight`: its share of the probability of the whole set, 0 to 1.
    """

    effect: str
    joint: str | None
    weight: Number


@dataclass(frozen=True)
class Gap:
    """A gap before and after one step, on data not used to fit.

    - `before`, `after`: RMS, N m or rad (N, m for a prismatic joint)
    - `noise_floor`: RMS that no model can pass; None where it is unknown
    - `shrinkage`: share of the part above the noise floor that goes: (before − after) / (before −
      floor); where the floor is unknown, 1 − after / before
    - `ci95`: of the shrinkage, by a bootstrap over blocks of time
    """

    before: Number
    after: Number
    noise_floor: float | None = None
    shrinkage: float | None = None
    ci95: tuple[Number, Number] | None = None

    @classmethod
    def between(cls, before: float, after: float, floor: float | None = None) -> "Gap":
        """Return one with its shrinkage, where anything is above the noise floor."""
        room = before - (floor or 0.0)
        shrinkage = (before - after) / room if room > LEAST_ROOM * before else None
        return cls(before, after, floor, shrinkage)


@dataclass(frozen=True)
class SimulationGap(Gap):
    """A tracking error before and after; nothing says which part of it is noise."""

    noise_floor: Annotated[None, Field(exclude=True)] = None


@dataclass(frozen=True)
class JointChange:
    """What one cause takes of the torque gap at one joint.

    - `before`, `after`: RMS of the torque gap, beside the causes before it, N m (N)
    - `share_of_torque`: root of before² − after², as a share of the joint's torque (rms); negative
      where the gap grows
    """

    joint: str
    before: Number
    after: Number
    share_of_torque: Number


@dataclass(frozen=True)
class ParameterError:
    """What parameter errors make of the nominal model's torque gap at one joint, rms, N m (N).

    - `given`: of the nominal model
    - `named`: with the parametric causes that are listed
    - `refit`: with new base parameters
    - `remaining`: root of named² − refit²: the parameter error that no listed cause accounts for
    - `share_of_torque`: of that, as a share of the joint's torque (rms)
    """

    joint: str
    given: Number
    named: Number
    refit: Number
    remaining: Number
    share_of_torque: Number


@dataclass(frozen=True, kw_only=True)
class Attribution:
    """An effect at its place with its numbers: what causes, hints and changes have in common.

    - `effect`: name in the catalogue
    - `joint`, `other_joint`: None where it belongs to no joint; the second joint is that of a
      coupling
    - `sentence`: what a robot engineer should read: where, what, how large, how far the gap
      shrinks; of a hint why it is no cause
    """

    effect: str
    joint: str | None
    other_joint: str | None = None
    sentence: str
    parameters: dict[str, EffectParameter]


@dataclass(frozen=True, kw_only=True)
class Cause(Attribution):
    """One accepted cause of the gap.

    - `torque_gap`: at the joint; over all joints where it belongs to none
    - `joint_gaps`: joints whose torque gap it changes noticeably, its own first
    - `simulation_gap`: tracking error of the simulated closed loop against the recorded one; None
      where the loop cannot be simulated
    - `probability`: that it is a cause, 0 to 1, calibrated on simulated recordings
      (`comparison.probability`); None of what other rows than the torque's show, which nothing was
      calibrated for
    """

    kind: Kind
    evidence: Evidence
    indistinguishable_from: tuple[Indistinguishable, ...] = ()
    torque_gap: Gap
    joint_gaps: tuple[JointChange, ...] = ()
    simulation_gap: SimulationGap | None = None
    probability: float | None = None


@dataclass(frozen=True, kw_only=True)
class Hint(Attribution):
    """What a search over all data finds, and what is not sure enough for a cause.

    An effect that does not hold without the data that chose it, or a parameter error each of whose
    numbers may be zero beside errors of all other given numbers.

    - `reason`: why it is no cause
    - `probability`: that it, or what the recording cannot tell from it, is a cause, 0 to 1,
      calibrated; None where something else speaks against it
    - `chosen_in_folds`: without how many of the folds a search names it again: ``2 of 5``; empty
      for a parameter error
    - `torque_gap`: at the joint, on data that did not choose it; of a parameter error, by itself
      and on all data
    """

    joint: str
    reason: str
    chosen_in_folds: str
    torque_gap: Gap
    probability: float | None = None


@dataclass(frozen=True)
class Unexplained:
    """What no effect of the catalogue explains.

    `share`: of the energy of the whitened residual at that joint, 0 to 1: what the nonparametric
    alternative takes off that of the refit; of events, what the largest 1 % of the samples hold.
    """

    joint: str
    family: Family
    share: Number
    where: str

    def likeliest(self, hints: Sequence[Hint]) -> Hint | None:
        """Return the likeliest effect of the catalogue that it may be; None where there is none."""
        there = [
            hint for hint in hints if hint.joint == self.joint and hint.probability is not None
        ]
        return max(there, key=lambda hint: hint.probability or 0.0, default=None)
