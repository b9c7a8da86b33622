"""What was measured of a transmission, in sentences."""

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.result import Cause, Transmission
from idim_iv_ros.diagnosis.sentences import with_interval

_BEHIND = "measured by the encoder behind the gear"
# A shaft this stiff (N m/rad) is only the limit of arithmetic: encoders without noise.
_RIGID = 1e12


def described(found: Transmission) -> str:
    """All that was measured of one transmission, in one sentence."""
    where = f"gear of {found.joint}"
    if found.time_offset is None:
        return f"{where}: {found.reason}"
    small = f"m{found.unit}"
    if found.stiffness is not None:
        text = f"{where}: stiffness {with_interval(found.stiffness)}"
        if found.damping is not None:
            text += f", damping {with_interval(found.damping)}"
    else:
        text = f"{where}: no stiffness is measured, {found.reason}"
        if found.stiffness_at_least is not None and found.stiffness_at_least < _RIGID:
            unit = "N m/rad" if found.unit == "rad" else "N/m"
            text += f" (95 %: at least {found.stiffness_at_least:.2g} {unit})"
    if found.backlash is not None:
        text += f"; play {with_interval(found.backlash, 1e3, small)}"
    elif found.backlash_at_most is not None:
        text += f"; no play is seen, at most {1e3 * found.backlash_at_most:.2g} {small} (95 %)"
    else:
        text += "; play cannot be determined, the load hardly changes its side"
    if found.lost_motion is not None:
        text += (
            f"; {with_interval(found.lost_motion, 1e3, small)} follow the direction of motion "
            "(play that friction keeps on one side, or friction behind the gear)"
        )
    if found.position_error:
        text += "; an error of an encoder over the position was taken out"
    return f"{text}; {offset_words(found)}"


def offset_words(found: Transmission) -> str:
    """Say the time between the two channels."""
    assert found.time_offset is not None
    offset = found.time_offset
    late = "late" if offset.value >= 0.0 else "early"
    half = "" if offset.std is None else f" ± {1e3 * settings.NORMAL_95 * offset.std:.2g}"
    return f"the link is read {1e3 * abs(offset.value):.3g}{half} ms {late}, which is no elasticity"


def elasticity(found: Transmission) -> str:
    """Where a shaft twists, measured by the encoder behind it."""
    assert found.stiffness is not None
    rms = 1e3 * found.twist_rms * found.elastic_share**0.5
    return (
        f"elasticity at {found.joint}, {_BEHIND}: stiffness "
        f"{with_interval(found.stiffness)}; under the load the gear twists by {rms:.2g} "
        f"m{found.unit} rms, {100.0 * found.elastic_share:.0f} % of what motor and link "
        f"differ by ({offset_words(found)})"
    )


def backlash(found: Transmission) -> str:
    """Where a gear has play, measured by the encoder behind it."""
    assert found.backlash is not None
    gap = with_interval(found.backlash, 1e3, f"m{found.unit}")
    text = f"backlash at {found.joint}, {_BEHIND}: gap {gap}"
    if found.stiffness is not None:
        text += f", stiffness beyond it {with_interval(found.stiffness)}"
    return f"{text} ({offset_words(found)})"


def measured_behind(cause: Cause) -> bool:
    """Whether a cause was measured by an encoder behind the gear."""
    return _BEHIND in cause.sentence


def refuted(found: Transmission, effect: str) -> str:
    """Say which effect on the torque the encoder behind the gear excludes."""
    return (
        f"on the torque alone an {effect} at {found.joint} would help; the encoder behind the gear "
        f"excludes one of that size ({described(found)})"
    )
