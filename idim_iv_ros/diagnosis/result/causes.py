"""Causes, hints, parameter errors, and what is left unexplained."""

from dataclasses import dataclass

from idim_iv_ros.diagnosis.result.evidence import (
    Evidence,
    Gap,
    Indistinguishable,
    JointChange,
    SimulationGap,
)
from idim_iv_ros.documents import Number
from idim_iv_ros.effects.cause import EffectParameter, Family, Kind


@dataclass(frozen=True)
class ParameterError:
    """What parameter errors make of the nominal model's torque gap at one joint, rms, N m (N).

    Attributes
    ----------
    joint : str
    given : float
        Of the nominal model.
    named : float
        With the parametric causes that are listed.
    refit : float
        With new base parameters.
    remaining : float
        Root of named² − refit²: the parameter error that no listed cause accounts for.
    share_of_torque : float
        Of that, as a share of the joint's torque (rms).
    """

    joint: str
    given: Number
    named: Number
    refit: Number
    remaining: Number
    share_of_torque: Number


@dataclass(frozen=True, kw_only=True)
class Cause:
    """One accepted cause of the gap.

    Attributes
    ----------
    effect : str
        Name in the catalogue.
    kind : str
    joint : str or None
        None where the cause belongs to no joint.
    other_joint : str or None
        The second joint of a coupling.
    sentence : str
        What a robot engineer should read: where, what, how large, how far the gap shrinks.
    parameters : dict of str to EffectParameter
    probability : float or None
        That it is a cause, 0 to 1, calibrated on simulated recordings (`comparison.probability`);
        None of what other rows than the torque's show, which nothing was calibrated for.
    evidence : Evidence
    indistinguishable_from : tuple of Indistinguishable
    torque_gap : Gap
        At the joint; over all joints where it belongs to none.
    joint_gaps : tuple of JointChange
        Joints whose torque gap it changes noticeably, its own first.
    simulation_gap : SimulationGap or None
        Tracking error of the simulated closed loop against the recorded one; None where the
        loop cannot be simulated.
    """

    effect: str
    kind: Kind
    joint: str | None
    other_joint: str | None
    sentence: str
    parameters: dict[str, EffectParameter]
    evidence: Evidence
    indistinguishable_from: tuple[Indistinguishable, ...]
    torque_gap: Gap
    joint_gaps: tuple[JointChange, ...] = ()
    simulation_gap: SimulationGap | None
    probability: float | None = None


@dataclass(frozen=True, kw_only=True)
class Hint:
    """What a search over all data finds, and what is not sure enough for a cause.

    An effect that does not hold without the data that chose it, or a parameter error each of whose
    numbers may be zero beside errors of all other given numbers.

    Attributes
    ----------
    effect : str
    joint : str
    other_joint : str or None
    sentence : str
        What it would be, and why it is only a hint.
    reason : str
        The second half of that.
    parameters : dict of str to EffectParameter
        If it were a cause.
    chosen_in_folds : str
        Without how many of the folds a search names it again: ``2 of 5``; empty for a parameter
        error.
    torque_gap : Gap
        At the joint, on data that did not choose it; of a parameter error, by itself and on all
        data.
    """

    effect: str
    joint: str
    other_joint: str | None
    sentence: str
    reason: str
    parameters: dict[str, EffectParameter]
    chosen_in_folds: str
    torque_gap: Gap


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
