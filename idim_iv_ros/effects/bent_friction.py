"""What friction needs that bends with the speed: Stribeck friction and nonlinear drag."""

from idim_iv_ros.effects.effect import OperatingRange

_LEAST_SPEED = 0.25  # rad/s: Stribeck speeds of arms are 0.02 to 0.3 rad/s


def too_slow_to_bend(joint: int, covered: OperatingRange) -> str:
    """Why a joint's motion cannot show how friction bends; empty where it may."""
    fastest = float(covered.fastest[joint])
    if fastest >= _LEAST_SPEED * float(covered.lever[joint]):
        return ""
    length = covered.length(joint)
    return f"the joint moves at most {fastest:.2g} {length}/s: too slow to show bent friction"
