"""All estimates of one identification, parameter by parameter."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.estimation.covariance import AutocorrelatedCovariance, WhiteCovariance
from idim_iv_ros.estimation.essential import EssentialParameters
from idim_iv_ros.estimation.idim_iv import IdimIvEstimate
from idim_iv_ros.estimation.least_squares import (
    LinearEstimate,
    solve_instrumental_variables,
    solve_least_squares,
)
from idim_iv_ros.estimation.refined import RefinedIdimIv, residual_models
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.estimation.sources import InstrumentSources
from idim_iv_ros.identification.prepare import PreparedRegression
from idim_iv_ros.identification.result import ParameterEstimate
from idim_iv_ros.types import FloatArray

Estimator = Literal["idim-iv", "idim-ls"]


@dataclass(frozen=True)
class Estimates:
    """All estimates of one identification.

    Attributes
    ----------
    estimator : str
    rows : tuple of JointRows
        With the instruments of the estimate that is reported.
    linear : LinearEstimate
        That estimate.
    weighted : LinearEstimate
        Joint-weighted IDIM-LS.
    iteration : IdimIvEstimate or None
    sources : InstrumentSources or None
    refined : RefinedIdimIv
    """

    estimator: Estimator
    rows: Sequence[JointRows]
    linear: LinearEstimate
    weighted: LinearEstimate
    iteration: IdimIvEstimate | None
    sources: InstrumentSources | None
    refined: RefinedIdimIv


def estimated_parameters(
    prepared: PreparedRegression,
    estimates: Estimates,
    covariance: AutocorrelatedCovariance,
    essential: EssentialParameters,
) -> tuple[ParameterEstimate, ...]:
    """Every base parameter with its standard deviations, alone and among the essential ones."""
    base = prepared.model.base
    rows, weighted, linear = estimates.rows, estimates.weighted, estimates.linear
    std = np.sqrt(np.diag(covariance.matrix))
    white = WhiteCovariance(rows, linear.sigma, len(linear.values)).matrix
    white_std = np.sqrt(np.diag(white))
    ls_std = std
    if estimates.iteration is not None:
        models = residual_models(rows, weighted.residuals)
        observed = [joint.with_instruments(joint.matrix) for joint in rows]
        ls_covariance = AutocorrelatedCovariance(
            observed, weighted.sigma, models, len(weighted.values)
        )
        ls_std = np.sqrt(np.diag(ls_covariance.matrix))
    ordinary = solve_least_squares(rows, len(base.columns), weighted=False)
    given = prepared.given
    places = {int(column): place for place, column in enumerate(essential.columns)}
    reduced = _essential_values(estimates, essential.columns)
    reduced_std = np.sqrt(np.diag(covariance.restricted(essential.columns)))
    return tuple(
        ParameterEstimate(
            name=base.names[k],
            expression=base.expressions[k],
            unit=base.units[k],
            value=float(linear.values[k]),
            std=float(std[k]),
            white_std=float(white_std[k]),
            essential=k in places,
            essential_value=float(reduced[places[k]]) if k in places else None,
            essential_std=float(reduced_std[places[k]]) if k in places else None,
            ls_value=float(weighted.values[k]),
            ls_std=float(ls_std[k]),
            ordinary_ls_value=float(ordinary.values[k]),
            given_value=None if given is None else float(given[k]),
            non_negative=base.non_negative[k],
        )
        for k in range(len(base.columns))
    )


def _essential_values(estimates: Estimates, kept: NDArray[np.int64]) -> FloatArray:
    """Estimate again with the essential parameters only, same weights: (b_e,)."""
    rows = [joint.reduced.keep(kept) for joint in estimates.rows]
    return solve_instrumental_variables(rows, len(kept), estimates.linear.sigma).values
