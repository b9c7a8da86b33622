"""What a motion that is poor cannot show of any effect, whatever the torque says."""

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.effects.effect import Effect, OperatingRange


def cannot_show(effect: Effect, joint: int, covered: OperatingRange) -> str:
    """Why an effect cannot be seen at a joint whatever its size; empty where it may be.

    Each effect adds what it needs itself.
    """
    lever = float(covered.lever[joint])
    span, length = covered.span(joint), covered.length(joint)
    fastest = float(covered.fastest[joint])
    if (
        span <= settings.LEAST_RANGE * lever
        or fastest <= settings.LEAST_SPEED_RANGE * covered.slowest[joint]
    ):
        return f"the joint hardly moves ({span:.2g} {length})"
    if fastest < settings.LEAST_FASTEST * lever:
        return (
            f"the joint moves at most {fastest:.2g} {length}/s: it sticks so often that nothing "
            "can be told from its dry friction"
        )
    return effect.cannot_show(joint, covered)


def too_little(joint: int, covered: OperatingRange) -> bool:
    """Whether a joint moves so little that not even its numbers can be told.

    Slow motion over a wide range shows weights and friction well; small motion that sticks shows
    nothing.
    """
    lever = float(covered.lever[joint])
    span = covered.span(joint)
    fastest = float(covered.fastest[joint])
    if span <= settings.LEAST_RANGE * lever:
        return True
    return fastest < settings.LEAST_FASTEST * lever and span < settings.SMALL_RANGE * lever
