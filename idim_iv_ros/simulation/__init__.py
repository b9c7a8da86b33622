"""Closed-loop simulation of a robot with any dynamic parameters."""

from idim_iv_ros.simulation.closed_loop import ClosedLoopResult, simulate_closed_loop
from idim_iv_ros.simulation.controller import ControlLaw, control_law
from idim_iv_ros.simulation.inverse_dynamics import inverse_dynamics, mass_matrix

__all__ = [
    "ClosedLoopResult",
    "ControlLaw",
    "control_law",
    "inverse_dynamics",
    "mass_matrix",
    "simulate_closed_loop",
]
