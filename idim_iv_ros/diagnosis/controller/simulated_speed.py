"""The speed that the law of the simulated loop sees: that of the robot's own law.

With kd on an exact speed the simulated loop is damped more than one whose speed is milliseconds
late; the difference in motion then looks like elasticity, backlash or a torque that saturates.
"""

from collections.abc import Sequence
from dataclasses import replace

from idim_iv_ros.diagnosis.controller.law_speed import law_speed
from idim_iv_ros.estimation.instruments import SimulatedLoop
from idim_iv_ros.estimation.sources import InstrumentSources
from idim_iv_ros.signals import Motion
from idim_iv_ros.simulation import ControlLaw, factor_of_lateness


def with_law_speed(sources: InstrumentSources) -> InstrumentSources:
    """Give the laws of the simulated loop the speed that reproduces the recorded commands.

    Nothing changes where the law is fitted (with what the recording holds of the speed), or where
    no differences of the position reproduce the commands better than the plain ones.
    """
    first, *others = sources.sources
    if sources.fits or not isinstance(first, SimulatedLoop):
        return sources
    laws = laws_with_speed(first.motions, first.laws)
    return replace(sources, sources=(replace(first, laws=laws), *others))


def laws_with_speed(
    motions: Sequence[Motion], laws: Sequence[ControlLaw]
) -> tuple[ControlLaw, ...]:
    """Filter the speed of each recording's law so that it is as late as that of the robot's law.

    The robot has one law: it is compared with the commands of all recordings. A recorded velocity
    that the law uses is imitated by the filter that reproduces the commands best.
    """
    speed = law_speed(motions, laws[0], computed=True)
    if speed.kind != "filtered":
        return tuple(laws)
    made = []
    for motion, law in zip(motions, laws, strict=True):
        rate = motion.signals.rate
        period = 1.0 / rate if law.period is None else law.period
        made.append(replace(law, speed_factor=factor_of_lateness(speed.lateness(rate), period)))
    return tuple(made)
