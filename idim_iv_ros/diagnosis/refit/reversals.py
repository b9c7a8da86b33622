"""Whether rows beside a reversal count: only where it is known when joints stick and slip.

At a reversal dry friction crosses from one level to the other while the joint sticks. A simulated
closed loop tells when; without one only the sign of the measured speed is left, which is wrong
there by as much as the friction, and the decimation filter smears that over the rows around.
"""

from collections.abc import Sequence

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.estimation.idim_iv import IdimIvEstimate
from idim_iv_ros.recording import Recording
from idim_iv_ros.signals import REVERSAL_MARGIN


def may_count(configuration: Configuration, recordings: Sequence[Recording]) -> bool:
    """Whether the loop may be simulated with a configured law, and the user leaves it open."""
    return (
        configuration.processing.reversal_margin is None
        and configuration.controller.type != "unknown"
        and all(recording.position_reference is not None for recording in recordings)
    )


def with_margin(configuration: Configuration, margin: float) -> Configuration:
    """Return the configuration with rows dropped so far from a slow sample."""
    processing = configuration.processing.model_copy(update={"reversal_margin": margin})
    return configuration.model_copy(update={"processing": processing})


def reason_for_margin(
    configuration: Configuration, margin: float, estimate: IdimIvEstimate, *, sticking: bool
) -> str:
    """Say whether rows beside a reversal count, and why.

    Parameters
    ----------
    configuration
        As the user gave it.
    margin
        Decimated samples on either side of a slow one that were dropped.
    sticking
        Whether it is known where joints stick.
    """
    given = configuration.processing.reversal_margin
    why = _why_not(configuration, estimate)
    if given is not None:
        if sticking or given >= REVERSAL_MARGIN:
            return ""
        return (
            f"processing.reversal_margin {given:g} as configured, although it is not known where "
            f"joints stick ({why}): rows beside a reversal count with the sign of the speed"
        )
    if margin < REVERSAL_MARGIN:
        return (
            f"rows beside a reversal count (processing.reversal_margin {margin:g} proposed): the "
            "closed loop is simulated, and tells where joints stick"
        )
    return (
        f"rows beside a reversal do not count (processing.reversal_margin {margin:g} proposed): "
        f"it is not known where joints stick, for {why}"
    )


def _why_not(configuration: Configuration, estimate: IdimIvEstimate) -> str:
    if configuration.controller.type == "unknown":
        return "the control law is not configured"
    if estimate.failures:
        return f"the closed loop cannot be simulated: {estimate.failures[0]}"
    return "the closed loop is not simulated"
