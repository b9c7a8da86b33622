"""All estimates of one identification, parameter by parameter."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.estimation import (
    AutocorrelatedBlock,
    AutocorrelatedCovariance,
    EssentialParameters,
    IdimIvEstimate,
    InstrumentSources,
    LinearEstimate,
    ObservationRows,
    RefinedIdimIv,
    WhiteCovariance,
    instrument_triangles,
    keep_parameters,
    residual_models,
    solve_instrument_triangles,
    solve_least_squares,
)
from idim_iv_ros.identification.prepare import PreparedRegression
from idim_iv_ros.identification.result import ParameterEstimate
from idim_iv_ros.signals import AutoregressiveModel
from idim_iv_ros.types import FloatArray

Estimator = Literal["idim-iv", "idim-ls"]


@dataclass(frozen=True)
class Estimates:
    """All estimates of one identification.

    Attributes
    ----------
    estimator : str
    rows : tuple of ObservationRows
    linear : LinearEstimate
        The one that is reported.
    matrices : one (r_j, c_j) array for each joint
        Its instruments, the observation matrices for IDIM-LS.
    weighted : LinearEstimate
        Joint-weighted IDIM-LS.
    iteration : IdimIvEstimate or None
    sources : InstrumentSources or None
    refined : RefinedIdimIv
    """

    estimator: Estimator
    rows: Sequence[ObservationRows]
    linear: LinearEstimate
    matrices: Sequence[FloatArray]
    weighted: LinearEstimate
    iteration: IdimIvEstimate | None
    sources: InstrumentSources | None
    refined: RefinedIdimIv


def autocorrelated_covariance(
    rows: Sequence[ObservationRows],
    linear: LinearEstimate,
    matrices: Sequence[FloatArray],
    models: Sequence[AutoregressiveModel],
) -> AutocorrelatedCovariance:
    """Covariance of an estimate that knows the colour of each joint's residual.

    The instruments of joint j are `matrices[j]`, (r_j, c_j).
    """
    blocks = [
        AutocorrelatedBlock(
            joint.matrix, matrix, joint.columns, float(sigma), model, joint.position
        )
        for joint, matrix, sigma, model in zip(rows, matrices, linear.sigma, models, strict=True)
    ]
    return AutocorrelatedCovariance(blocks, len(linear.values))


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
    white = WhiteCovariance(covariance.blocks, len(linear.values)).matrix
    white_std = np.sqrt(np.diag(white))
    ls_std = std
    if estimates.iteration is not None:
        models = residual_models(rows, weighted.residuals)
        observed = [joint.matrix for joint in rows]
        ls_std = np.sqrt(
            np.diag(autocorrelated_covariance(rows, weighted, observed, models).matrix)
        )
    ordinary = solve_least_squares(rows, len(base.columns))
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
    triangles = [
        keep_parameters(triangle, kept)
        for triangle in instrument_triangles(estimates.rows, estimates.matrices)
    ]
    values, _ = solve_instrument_triangles(triangles, len(kept), estimates.linear.sigma)
    return values
