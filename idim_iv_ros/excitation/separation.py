"""What to record so that two effects that look alike can be told apart."""

from idim_iv_ros.excitation.segment import EFFECTS, NOT_REVEALED

# Pairs that no motion separates.
_NO_MOTION = {
    frozenset({"payload", "link_inertia"}): (
        "no motion does if the load is fixed to the link; take it off and record once more"
    ),
    frozenset({"torque_offset", "asymmetric_friction"}): (
        "no motion does: dry friction that differs between the directions is a constant torque "
        "beside its mean. Measure the torque without the drive's friction, behind the gear"
    ),
}


def separating_motion(first: str, second: str) -> str:
    """Return in words which segments of ``excite --for diagnosis`` separate two effects.

    A segment that reveals one effect and not the other separates them; where there is none,
    those that reveal either are named. Empty where nothing is known of both.
    """
    pair = frozenset({first, second})
    if pair in _NO_MOTION:
        return _NO_MOTION[pair]
    apart = [kind for kind, effects in EFFECTS.items() if (first in effects) != (second in effects)]
    either = [kind for kind, effects in EFFECTS.items() if first in effects or second in effects]
    needs = [NOT_REVEALED[each] for each in (first, second) if each in NOT_REVEALED]
    kinds = apart or either
    if kinds:
        names = " and ".join(filter(None, (", ".join(kinds[:-1]), kinds[-1])))
        plural = "s" if len(kinds) > 1 else ""
        needs.insert(0, f"the segment{plural} {names} of idim-iv excite --for diagnosis")
    return "; ".join(needs)
