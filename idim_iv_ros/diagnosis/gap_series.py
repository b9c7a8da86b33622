"""Measured torque and that of three models, row by row, for the figures."""

from idim_iv_ros.diagnosis.localisation.residual_split import motion_at_rows
from idim_iv_ros.diagnosis.refit.baseline import Baseline, nominal_residuals
from idim_iv_ros.diagnosis.result import GapSeries
from idim_iv_ros.diagnosis.structural.causes import NamedModel
from idim_iv_ros.diagnosis.structural.likelihood import Regression


def gap_series(data: Baseline, regression: Regression, model: NamedModel) -> tuple[GapSeries, ...]:
    """One series for each joint; `regression` is that of the refit."""
    residuals = nominal_residuals(data, regression)
    made = []
    for joint, name in enumerate(data.joints):
        torque = regression.joints[joint].torque
        motion = motion_at_rows(data, joint)
        made.append(
            GapSeries(
                joint=name,
                time=motion.time,
                torque=torque,
                given=None if residuals is None else torque - residuals[joint],
                refit=torque - model.fits[0].residuals[joint],
                extended=torque - model.fit.residuals[joint],
                position=motion.position,
                speed=motion.velocity,
                load=motion.load,
                since_reversal=motion.since_reversal,
                step=1.0 / data.row_rate,
            )
        )
    return tuple(made)
