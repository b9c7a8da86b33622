"""Closed-loop simulation of a robot with any dynamic parameters, and its control law."""

from idim_iv_ros.effects.control_law import ControlLaw
from idim_iv_ros.simulation.closed_loop import ClosedLoopResult, simulate_closed_loop
from idim_iv_ros.simulation.controller import (
    ControllerFit,
    control_law,
    control_period,
    factor_of_lateness,
    fit_controller,
)
from idim_iv_ros.simulation.effects import SimulatedEffect
from idim_iv_ros.simulation.recorded_robot import SimulatedRecording, record_simulated_robot
from idim_iv_ros.simulation.reference_filter import filter_reference
from idim_iv_ros.simulation.rigid_body import inverse_dynamics, joint_inertia, mass_matrix

__all__ = [
    "ClosedLoopResult",
    "ControlLaw",
    "ControllerFit",
    "SimulatedEffect",
    "SimulatedRecording",
    "control_law",
    "control_period",
    "factor_of_lateness",
    "filter_reference",
    "fit_controller",
    "inverse_dynamics",
    "joint_inertia",
    "mass_matrix",
    "record_simulated_robot",
    "simulate_closed_loop",
]
