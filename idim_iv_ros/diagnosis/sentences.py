"""Every sentence about what was found, made from values: the terminal and the report show them."""

from collections.abc import Iterable, Sequence

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.controller.law_event import LawEvent
from idim_iv_ros.diagnosis.localisation.where import Finding
from idim_iv_ros.diagnosis.parameter_words import parameter_words, surest
from idim_iv_ros.diagnosis.parametric.evidence import ParametricCause
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import (
    Cause,
    EffectParameter,
    Gap,
    JointChange,
    JointGap,
    ParameterError,
    RecordingAgreement,
    Unexplained,
    Verdict,
)
from idim_iv_ros.diagnosis.structural.candidate import Candidate
from idim_iv_ros.diagnosis.structural.nonparametric import Nonparametric, StopShape
from idim_iv_ros.diagnosis.structural.rules import Judged
from idim_iv_ros.effects.link_inertia import LinkInertia
from idim_iv_ros.recording import SessionPart, in_recordings
from idim_iv_ros.types import FloatArray


def structural_cause(
    data: Baseline,
    effect: Candidate,
    others: Sequence[Judged],
    gap: Gap,
    gain: float,
    *,
    together: bool = False,
) -> str:
    """Where an effect is and how far the gap shrinks.

    Parameters
    ----------
    others
        Candidates that are indistinguishable from it.
    gain
        Share of the residual's energy that goes on held-out data.
    together
        Whether its numbers are known to differ from zero only all together.
    """
    place = effect.place
    joint, unit = data.joints[place.joint], data.unit_at(place.joint, "N m")
    where = joint if place.other is None else f"{joint} and {data.joints[place.other]}"
    kind = effect.effect.meaning(effect.shape)
    text = (
        f"{_spaced(effect.effect.name)} at {where}{kind and f' ({kind})'}: "
        f"the torque gap at {joint} falls from {gap.before:.3g} to {gap.after:.3g} {unit} "
        "on data not used to choose or fit it"
    )
    if gap.noise_floor is not None:
        text += f" (noise {gap.noise_floor:.3g} {unit})"
    text += _indistinguishable(
        f"{_spaced(other.effect.name)} at {data.joints[other.place.joint]}" for other in others
    )
    if together:
        text += "; its torque is known, each of its numbers by itself is not"
    if gain <= 0.0:
        text += "; it does not help on held-out data, so do not rely on it"
    elif gap.ci95 is not None and gap.ci95[0] <= 0.0:
        low, high = (100.0 * limit for limit in gap.ci95)
        text += (
            f"; that it is there is sure, how much of the gap goes is not: {low:.0f} to "
            f"{high:.0f} % (95 %)"
        )
    return text


def hint(
    effect: str, joints: Sequence[str], parameters: dict[str, EffectParameter], reason: str
) -> str:
    """Say what a doubtful effect would be, and why it is no cause."""
    numbers = _numbers(effect, parameters, settings.MOST_NUMBERS_IN_SENTENCE)
    place = " and ".join(joints)
    return (
        f"{_spaced(effect)} at {place}{f' ({numbers})' if numbers else ''}: only a hint, {reason}"
    )


def disagreement(differing: Sequence[RecordingAgreement]) -> str:
    """Which recordings the parameters of the others do not fit, and what differs; else empty."""
    named = [each for each in differing if each.differences]
    if not named:
        return ""
    each = "; ".join(_difference(recording) for recording in named)
    return (
        f"One set of parameters does not hold for all recordings: {each}. All other numbers are "
        "means over the recordings: diagnose those that agree by themselves."
    )


def unexplained_disagreement(differing: Sequence[RecordingAgreement]) -> str:
    """Recordings that parameters of their own predict better, without a parameter error."""
    each = ", ".join(
        f"{one.bag} ({100.0 * one.share_of_torque:.2g} % of the torque at {one.joint})"
        for one in differing
        if not one.differences
    )
    return each and (
        f"Parameters of their own predict better: {each}. The model misses what only their motion "
        "shows, or something changed between the recordings that is no parameter."
    )


def _difference(recording: RecordingAgreement) -> str:
    share = 100.0 * recording.share_of_torque
    text = f"{recording.bag} differs by {share:.2g} % of the torque at {recording.joint}"
    causes = ", ".join(
        f"{_spaced(one.effect)}{f' of {one.joint}' if one.joint else ''} "
        f"({_numbers(one.effect, one.parameters, settings.MOST_NUMBERS_IN_SENTENCE)})"
        for one in recording.differences
    )
    return f"{text}, with the others as nominal model: {causes}"


def parametric_cause(data: Baseline, cause: ParametricCause, changed: Sequence[JointChange]) -> str:
    """Which parameters are in error, by how much, and what correcting them takes of the gap."""
    place = cause.joint or ""
    if cause.joint and cause.effect.name == LinkInertia.name:
        place += f" (link {data.joints.index(cause.joint) + 1})"
    # Of a cause of no single joint all: one for each joint.
    most = settings.MOST_NUMBERS_IN_SENTENCE if cause.joint else len(cause.parameters)
    text = f"{cause.effect.subject(place)}: {_numbers(cause.effect.name, cause.parameters, most)}"
    mass = cause.parameters.get("mass")
    if mass is not None and mass.value < 0.0:
        text += " (negative: a part that the nominal model has is not mounted)"
    scale = data.prepared.configuration.signals.effort_scale
    if mass is not None and scale is not None and any(each != 1.0 for each in scale):
        text += (
            "; its interval takes signals.effort_scale as exact: where that is known to x %, the "
            "mass is uncertain by x % more"
        )
    smaller = [_change(data, each) for each in changed if each.share_of_torque > 0.0]
    if smaller:
        text += f"; correcting it reduces the torque gap {', '.join(smaller)}"
    return text + _indistinguishable(
        _spaced(other.effect) + (f" of {other.joint}" if other.joint else "")
        for other in cause.indistinguishable_from
    )


def controller_cause(
    data: Baseline, joint: int, gap: Gap, effect: str, parameters: dict[str, EffectParameter]
) -> str:
    """Commands that are not those of the configured law, and with which law they are."""
    unit = data.unit_at(joint, "N m")
    return (
        f"another control law than configured at {data.joints[joint]}: recorded and computed "
        f"commands differ by {gap.before:.3g} {unit}, and by {gap.after:.3g} {unit} with "
        f"{_numbers(effect, parameters, settings.MOST_NUMBERS_IN_SENTENCE)}"
    )


def missing_gravity(acceleration: FloatArray) -> str:
    """Gravity (3,) m/s² that the nominal model lacks."""
    found = ", ".join(f"{value:.2g}" for value in acceleration)
    return (
        f"the nominal model has no gravity, but the recordings show it: ({found}) m/s² with the "
        "masses of the nominal model. Everything else was diagnosed with gravity in this direction"
    )


def delay_of_all(delay: EffectParameter, period: float, support: float) -> str:
    """A delay of all joints that no control of this period (s) makes; `support`: of the loop."""
    assert delay.std is not None
    half = 1e3 * settings.NORMAL_95 * delay.std
    if abs(support) < settings.LEAST_SUPPORT:
        which = "which this recording cannot tell"
    else:
        which = f"the motion is that of a loop with{'' if support > 0.0 else 'out'} the delay"
    return (
        f"time delay of all joints: efforts act {1e3 * delay.value:.3f} ± {half:.2g} ms after "
        f"their stamps ({delay.value / period:.2f} control periods, of which a held command takes "
        f"half a one): the stamps are early, or commands take that long in the loop; {which}. "
        "Everything else was diagnosed with efforts at the time at which they act"
    )


def beyond_the_law(
    data: Baseline,
    joint: int,
    sizes: tuple[float, float],
    events: Sequence[LawEvent],
) -> str:
    """What a joint's commands hold beyond the law and its changes.

    Parameters
    ----------
    sizes
        RMS of that and of the command, N m (N).
    events
        The largest first; empty where it acts all the time.
    """
    beyond, command = sizes
    text = (
        f"the commands of {data.joints[joint]} hold {beyond:.3g} {data.unit_at(joint, 'N m')} rms "
        f"beyond the control law ({100.0 * beyond / max(command, 1e-300):.0f} % of the command)"
    )
    if events:
        most = settings.LAW_MOST_EVENTS
        names = [recording.path.name for recording in data.prepared.recordings]
        unit = data.unit_at(joint, "N m")
        shown = [
            f"{each.size:+.3g} {unit} from {each.begin:.2f} to {each.end:.2f} s of "
            f"{names[each.recording]}"
            for each in events[:most]
        ]
        more = len(events) - len(shown)
        text += f", most of it {', '.join(shown)}" + (f" and {more} more times" if more else "")
    return f"{text}: no change of a gain or feedforward explains it"


def remaining_parameter_errors(data: Baseline, errors: Sequence[ParameterError]) -> str:
    """Parameter errors that no cause names, joint by joint; empty where there are none."""
    listed = ", ".join(
        f"{each.remaining:.3g} {data.unit_at(data.joints.index(each.joint), 'N m')} at "
        f"{each.joint} ({100.0 * each.share_of_torque:.2g} % of its torque)"
        for each in errors
    )
    return listed and (
        f"Remaining parameter error: {listed}; refitted parameters remove it, but which of the "
        "given ones are in error cannot be determined."
    )


def unexplained_residual(data: Baseline, lacking: Sequence[tuple[int, float, float, float]]) -> str:
    """Joints at which the last model misses much: (joint, rms, share of the torque, noise)."""
    listed = ", ".join(
        f"{rms:.3g} {data.unit_at(joint, 'N m')} at {data.joints[joint]} "
        f"({100 * share:.0f} % of its torque, noise {noise:.2g} {data.unit_at(joint, 'N m')})"
        for joint, rms, share, noise in lacking
    )
    return listed and f"Unexplained residual: {listed}; the causes are not the whole gap there."


def nonparametric(data: Baseline, candidate: Candidate) -> str:
    """What a function that is no effect of the catalogue describes, and where."""
    joint = candidate.place.joint
    effect = candidate.effect
    if not isinstance(effect, Nonparametric):
        name = _spaced(effect.name)
        return f"{data.joints[joint]}: a torque like that of {name}, which it cannot be (see hints)"
    text = f"{data.joints[joint]}: a torque that {effect.words}"
    shape = candidate.shape
    if isinstance(shape, StopShape):
        side = "above" if shape.side > 0 else "below"
        text += f", {side} {shape.position:.3g} {data.unit_at(joint, 'rad')}"
    return text


def small_nonparametric(data: Baseline, candidate: Candidate) -> str:
    """The same where it is too small to matter."""
    share = 100.0 * candidate.share_of_torque(data.torque_sizes)
    return f"{nonparametric(data, candidate)}: {share:.2g} % of its torque, too small to matter"


def events(
    data: Baseline,
    joint: int,
    share: float,
    largest: tuple[int, float],
    every: Sequence[tuple[int, float]],
) -> str:
    """Short events that hold a share of a residual's energy.

    Parameters
    ----------
    largest, every
        (recording, s since its start) of the largest sample; of all events, the largest first.
    """
    bags = [part.bag for part in data.prepared.session.parts]
    text = (
        f"{data.joints[joint]}: {100 * settings.EVENT_SAMPLES:g} % of the samples hold "
        f"{100 * share:.0f} % of the residual's energy, the largest in {bags[largest[0]]} "
        f"{largest[1]:.1f} s after its start"
    )
    if len(every) > 1:
        shown = sorted(every[: settings.LAW_MOST_EVENTS])
        times = ", ".join(f"{time:.1f} s of {bags[recording]}" for recording, time in shown)
        text += f"; {len(every)} pulses, the strongest at {times}"
    return text


def finding(each: Finding, session: Sequence[SessionPart]) -> str:
    """Say a regime, such as "joint_2, below 0.1 rad/s: 61 % of the gap in 9 % of the samples".

    Parameters
    ----------
    session
        The recordings: a time is that of one of them.
    """
    regime = each.regime
    low, high = f"{regime.low:.2g}", f"{regime.high:.2g} {regime.unit}"
    part = f"between {low} and {high}"
    if regime.axis == "direction":
        part = f"moving in the {'negative' if regime.high <= 0.0 else 'positive'} direction"
    elif regime.axis == "reversal" and each.first:
        part = f"within {high} after a reversal"
    elif regime.axis == "time":
        part = f"from {in_recordings(session, regime.low, regime.high)}"
    elif each.first and regime.axis != "position":
        part = f"below {high}"
    elif each.last and regime.axis != "position":
        part = f"above {low} {regime.unit}"
    what = {
        "load": "load ",
        "reversal": "" if each.first else "displacement since reversal ",
        "frequency": "residual ",
    }.get(regime.axis, "")
    whole = "bandwidth" if regime.axis == "frequency" else "samples"
    return (
        f"{'after a refit, ' if each.after_refit else ''}{regime.joint}, {what}{part}: "
        f"{100 * regime.energy_share:.0f} % of the gap in {100 * regime.occupancy:.0f} % of the "
        f"{whole}"
    )


def summary(
    verdict: Verdict,
    causes: Sequence[Cause],
    unexplained: Unexplained | None,
    gaps: Sequence[JointGap],
    without: Sequence[str],
    *,
    more: int = 0,
    model: str = "nominal model",
    remaining: str = "",
    residual: str = "",
) -> str:
    """One paragraph that a robot engineer can act on.

    Parameters
    ----------
    causes
        Those that are listed here.
    without
        Effects that were left out of the catalogue.
    more
        How many smaller causes there are.
    model
        Whose gaps they are.
    remaining, residual
        See `remaining_parameter_errors` and `unexplained_residual`.
    """
    parts = []
    worst = max(gaps, key=lambda gap: gap.share, default=None)
    if worst is not None and worst.relative_percent is not None:
        parts.append(
            f"The {model} misses {worst.relative_percent:.3g} % of the torque at "
            f"{worst.joint}, where the gap is largest."
        )
    if verdict == "none":
        rest = ": the rest is noise, or too small for these recordings to show"
        parts.append(
            "No effect of the catalogue explains more of it than chance"
            f"{'' if remaining else rest}."
        )
    parts += [f"{capitalised(cause.sentence)}." for cause in causes]
    if more:
        others = "1 smaller cause is" if more == 1 else f"{more} smaller causes are"
        parts.append(f"{others} listed beside these.")
    parts.append(remaining)
    if unexplained is not None:
        share = f"; it explains {100 * unexplained.share:.0f} % of the refit's residual there"
        # Of events `where` says the share.
        parts.append(
            f"Not in the catalogue: {unexplained.where}"
            f"{'' if unexplained.family == 'event' else share}."
        )
    parts.append(residual)
    if without:
        parts.append(f"Left out of the catalogue on request: {', '.join(without)}.")
    return " ".join(part for part in parts if part)


def capitalised(text: str) -> str:
    """Return a sentence with its first letter large, the others as they are."""
    return text[:1].upper() + text[1:]


def _indistinguishable(others: Iterable[str]) -> str:
    listed = ", ".join(others)
    return listed and f"; on this recording it is indistinguishable from {listed}"


def _change(data: Baseline, each: JointChange) -> str:
    unit = data.unit_at(data.joints.index(each.joint), "N m")
    share = f"{100.0 * each.share_of_torque:.2g} % of its torque"
    return f"at {each.joint} from {each.before:.3g} to {each.after:.3g} {unit} ({share})"


def _numbers(effect: str, parameters: dict[str, EffectParameter], most: int) -> str:
    """A few parameters with their intervals, those that are surest of the fitted."""
    shown = []
    for name, parameter in surest(parameters, most).items():
        text = f"{parameter_words(effect, name)} {parameter.value:.3g}"
        if parameter.std is not None:
            text += f" ± {settings.NORMAL_95 * parameter.std:.2g}"
        shown.append(f"{text} {parameter.unit}".rstrip())
    return ", ".join(shown)


def _spaced(name: str) -> str:
    return name.replace("_", " ")
