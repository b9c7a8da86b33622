"""What a motion cannot show, whatever the torque says."""

from idim_iv_ros.gap.effects.effect import Extent

_LEAST_SESSION = 20.0  # s, for a drift
_LEAST_TURN = 0.5  # rad, for an error of once a turn
# rad and rad/s; for prismatic joints times the lever of a revolute one.
_LEAST_RANGE = 0.01
_LEAST_FASTEST = 0.1
_SMALL_RANGE = 0.1
# To show how friction bends: Stribeck speeds of arms are 0.02 to 0.3 rad/s.
_LEAST_SPEED = 0.25
_BENT = ("stribeck", "nonlinear_viscous")


def cannot_show(effect: str, joint: int, covered: Extent) -> str:
    """Why an effect cannot be seen at a joint whatever its size; empty where it may be."""
    lever = float(covered.lever[joint])
    span = float(covered.high[joint] - covered.low[joint])
    fastest = float(covered.fastest[joint])
    length = "rad" if lever == 1.0 else "m"
    if span <= _LEAST_RANGE * lever or fastest <= 1.5 * covered.slowest[joint]:
        return f"the joint hardly moves ({span:.2g} {length})"
    if fastest < _LEAST_FASTEST * lever:
        return (
            f"the joint moves at most {fastest:.2g} {length}/s: it sticks so often that nothing "
            "can be told from its dry friction"
        )
    if effect == "presliding" and not covered.sticking:
        return "where joints stick is not known, for the closed loop is not simulated"
    if effect == "friction_drift" and covered.duration < _LEAST_SESSION:
        return f"the session lasts {covered.duration:.2g} s: no warm-up shows in that"
    if effect == "encoder_eccentricity" and (lever != 1.0 or span < _LEAST_TURN):
        return f"the joint moves {span:.2g} {length}: an error of once a turn looks constant"
    if effect in _BENT and fastest < _LEAST_SPEED * lever:
        return f"the joint moves at most {fastest:.2g} {length}/s: too slow to show bent friction"
    return ""


def too_little(joint: int, covered: Extent) -> bool:
    """Whether a joint moves so little that not even its numbers can be told.

    Slow motion over a wide range shows weights and friction well; small motion that sticks shows
    nothing.
    """
    lever = float(covered.lever[joint])
    span = float(covered.high[joint] - covered.low[joint])
    fastest = float(covered.fastest[joint])
    if span <= _LEAST_RANGE * lever:
        return True
    return fastest < _LEAST_FASTEST * lever and span < _SMALL_RANGE * lever
