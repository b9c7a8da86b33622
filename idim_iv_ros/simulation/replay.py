"""The recorded reference once more, in the simulated closed loop."""

from collections.abc import Sequence

from idim_iv_ros.model import DynamicParameters, RobotModel
from idim_iv_ros.signals import Motion, central_differences
from idim_iv_ros.simulation.closed_loop import ClosedLoopResult, simulate_closed_loop
from idim_iv_ros.simulation.controller import ControlLaw
from idim_iv_ros.simulation.effects import SimulatedEffect


def replay(
    robot: RobotModel,
    parameters: DynamicParameters,
    law: ControlLaw,
    motion: Motion,
    *,
    effects: Sequence[SimulatedEffect] | None = None,
    start_time: float = 0.0,
    accelerations: bool = True,
) -> ClosedLoopResult:
    """Simulate a recording's whole reference from the state in which the recording began.

    Parameters
    ----------
    motion
        With a reference; the start is its filtered position and speed.
    effects, start_time, accelerations
        See `simulate_closed_loop`.

    Raises
    ------
    ValueError
        The recording has no reference.
    UsageError
        See `simulate_closed_loop`.
    """
    signals = motion.signals
    if signals.position_reference is None:
        raise ValueError(f"{signals.name} has no reference")
    velocity, _ = central_differences(motion.position, rate=signals.rate, start=0, stop=1)
    return simulate_closed_loop(
        robot,
        parameters,
        law,
        rate=signals.rate,
        position_reference=signals.position_reference,
        velocity_reference=signals.velocity_reference,
        initial_position=motion.position[0],
        initial_velocity=velocity[0],
        effects=effects,
        start_time=start_time,
        accelerations=accelerations,
    )
