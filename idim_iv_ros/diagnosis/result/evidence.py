"""How well a cause is supported: tests, folds, alternatives, gaps before and after."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from idim_iv_ros.documents import Number

# Tests of parameters hold for a model without any other error: their p-values would be too small.
NOT_CALIBRATED = "none: no recordings were simulated from a model without this cause"


@dataclass(frozen=True)
class Evidence:
    """Why an effect is believed.

    Attributes
    ----------
    statistic : float
        Twice the logarithm of the likelihood ratio, of whitened residuals, with and without
        (structural); Wald statistic of the change of the parameters (parametric).
    p_value : None
        None of a cause is calibrated.
    held_out_gain : float or None
        Share of the energy of the whitened residual that the effect removes, on blocks not used to
        fit; None where there are no such blocks.
    folds_positive : str
        On how many of the held-out blocks the effect helps: ``5 of 6``.
    chosen_in_folds : str
        Without how many of the folds a search names it again: ``5 of 5``; empty of causes that
        no search selects.
    p_value_from : str
        Why there is none.
    """

    statistic: Number
    p_value: float | None = None
    held_out_gain: float | None = None
    folds_positive: str = ""
    chosen_in_folds: str = ""
    p_value_from: str = NOT_CALIBRATED


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

    Attributes
    ----------
    before, after : float
        RMS, N m or rad (N, m for a prismatic joint).
    noise_floor : float or None
        RMS that no model can pass; None where it is unknown.
    shrinkage : float or None
        Share of the part above the noise floor that goes: (before − after) / (before − floor);
        where the floor is unknown, 1 − after / before.
    ci95 : (low, high) or None
        Of the shrinkage, by a bootstrap over blocks of time.
    """

    before: Number
    after: Number
    noise_floor: float | None
    shrinkage: float | None
    ci95: tuple[Number, Number] | None


@dataclass(frozen=True)
class SimulationGap(Gap):
    """A tracking error before and after; nothing says which part of it is noise."""

    noise_floor: Annotated[None, Field(exclude=True)] = None
    shrinkage: float | None = None
    ci95: tuple[Number, Number] | None = None


@dataclass(frozen=True)
class JointChange:
    """What one cause takes of the torque gap at one joint.

    Attributes
    ----------
    joint : str
    before, after : float
        RMS of the torque gap, beside the causes before it, N m (N).
    share_of_torque : float
        Root of before² − after², as a share of the joint's torque (rms); negative where the gap
        grows.
    """

    joint: str
    before: Number
    after: Number
    share_of_torque: Number
