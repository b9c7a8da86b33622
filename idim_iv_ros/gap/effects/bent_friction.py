"""What friction needs that bends with the speed: Stribeck friction and nonlinear drag."""

from idim_iv_ros.gap.effects.effect import Extent

_LEAST_SPEED = 0.25  # rad/s: Stribeck speeds of arms are 0.02 to 0.3 rad/s


def too_slow_to_bend(joint: int, extent: Extent) -> str:
    """Why a joint's motion cannot show how friction bends; empty where it may."""
    fastest = float(extent.fastest[joint])
    if fastest >= _LEAST_SPEED * float(extent.lever[joint]):
        return ""
    length = extent.length(joint)
    return f"the joint moves at most {fastest:.2g} {length}/s: too slow to show bent friction"
