"""IDIM-LS, IDIM-IV and refined IDIM-IV, with the covariance of their estimates."""

from idim_iv_ros.estimation.covariance import (
    AutocorrelatedBlock,
    AutocorrelatedCovariance,
    JointBlock,
    RefinedCovariance,
    WhiteCovariance,
)
from idim_iv_ros.estimation.essential import EssentialParameters, essential_parameters
from idim_iv_ros.estimation.fallback_instruments import FilteredReference, SmoothedMeasurement
from idim_iv_ros.estimation.idim_iv import IdimIvEstimate, idim_iv
from idim_iv_ros.estimation.instruments import (
    Instruments,
    InstrumentSource,
    SimulatedLoop,
    SourceFailure,
)
from idim_iv_ros.estimation.least_squares import (
    LinearEstimate,
    solve_instrument_triangles,
    solve_instrumental_variables,
    solve_least_squares,
    solve_triangles,
    solve_weighted_least_squares,
)
from idim_iv_ros.estimation.refined import RefinedIdimIv, refined_idim_iv, residual_models
from idim_iv_ros.estimation.rows import (
    ObservationRows,
    instrument_rows,
    observation_rows,
    torque_rows,
)
from idim_iv_ros.estimation.sources import InstrumentSources, instrument_sources
from idim_iv_ros.estimation.triangles import (
    JointTriangle,
    condition_number,
    instrument_triangles,
    keep_parameters,
    stream_triangles,
    triangles_of_rows,
    unseen_parameters,
    white_covariance,
)

__all__ = [
    "AutocorrelatedBlock",
    "AutocorrelatedCovariance",
    "EssentialParameters",
    "FilteredReference",
    "IdimIvEstimate",
    "InstrumentSource",
    "InstrumentSources",
    "Instruments",
    "JointBlock",
    "JointTriangle",
    "LinearEstimate",
    "ObservationRows",
    "RefinedCovariance",
    "RefinedIdimIv",
    "SimulatedLoop",
    "SmoothedMeasurement",
    "SourceFailure",
    "WhiteCovariance",
    "condition_number",
    "essential_parameters",
    "idim_iv",
    "instrument_rows",
    "instrument_sources",
    "instrument_triangles",
    "keep_parameters",
    "observation_rows",
    "refined_idim_iv",
    "residual_models",
    "solve_instrument_triangles",
    "solve_instrumental_variables",
    "solve_least_squares",
    "solve_triangles",
    "solve_weighted_least_squares",
    "stream_triangles",
    "torque_rows",
    "triangles_of_rows",
    "unseen_parameters",
    "white_covariance",
]
