"""Every sentence about what was found, made from values: the terminal and the report show them."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.comparison.curves import Nonparametric, StopShape
from idim_iv_ros.diagnosis.comparison.model_with_terms import Term
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.command_rows import LawEvent
from idim_iv_ros.diagnosis.result.causes import (
    Cause,
    Hint,
    Indistinguishable,
    ParameterError,
    Unexplained,
)
from idim_iv_ros.diagnosis.result.document import JointGap
from idim_iv_ros.diagnosis.result.recordings import RecordingAgreement, Transmission
from idim_iv_ros.effects.cause import EffectParameter, Parameters, surest
from idim_iv_ros.effects.parametric_effect import ParameterSpace, ParametricEffect
from idim_iv_ros.effects.registry import BY_NAME, parameter_words
from idim_iv_ros.errors import first_of
from idim_iv_ros.signals.motion import REVERSAL_MARGIN

MOST_EVENTS = 5  # that are listed
_MOST_CAUSES = 4  # after the first, in a summary
_MOST_NUMBERS = 3  # of a cause, in a sentence
# N m/rad: a shaft this stiff is only the limit of arithmetic, of encoders without noise.
_RIGID = 1e12


def structural_cause(data: Baseline, cause: Cause, meaning: str) -> str:
    """Where an effect is, how large, how probable, and how far the gap shrinks.

    `meaning`: which kind of the effect it is, in words; empty where there is one kind only.
    """
    assert cause.joint is not None
    where, gap = " and ".join(filter(None, (cause.joint, cause.other_joint))), cause.torque_gap
    floor = gap.noise_floor
    noise = "" if floor is None else f" (noise {torque(data, floor, cause.joint)})"
    falls = f"the torque gap at {cause.joint} falls"
    if gap.after >= gap.before:
        falls = f"beside new numbers, all of them free, the torque gap at {cause.joint} goes"
    return (
        f"{spaced(cause.effect)} at {where}{meaning and f' ({meaning})'}, "
        f"{likely(cause.probability)}: {listed_numbers(cause.effect, cause.parameters)}; {falls} "
        f"from {gap.before:.3g} to {torque(data, gap.after, cause.joint)} on data not used to fit "
        f"it{noise}{or_else(cause.indistinguishable_from)}"
    )


def likely(probability: float | None) -> str:
    """A probability in words; that of what nothing was calibrated for is not given."""
    if probability is None:
        return "no probability"
    return f"{min(round(100.0 * probability), 99)} % probable"


def hint(effect: str, joints: Sequence[str], parameters: Parameters, reason: str) -> str:
    """Say what a doubtful effect would be, and why it is no cause."""
    more = f" ({listed_numbers(effect, parameters)})" if parameters else ""
    return f"{spaced(effect)} at {' and '.join(joints)}{more}: only a hint, {reason}"


def disagreement(recordings: Sequence[RecordingAgreement], used: Sequence[str]) -> str:
    """Which recordings the parameters of the others do not fit, and what differs; else empty.

    `used`: bags that everything else is of.
    """
    differing = [recording for recording in recordings if not recording.agrees]
    if not differing:
        return ""
    first = max(differing, key=lambda recording: recording.share_of_torque)
    causes = [
        f"{placed(one.effect, one.joint)} ({listed_numbers(one.effect, one.parameters, 1)})"
        for one in first.differences
    ]
    rest = "all other numbers are means"
    if len(used) < len(recordings):
        rest = f"all else is of {first_of(used, _MOST_NUMBERS)}"
    return (
        f"one set of parameters does not hold for all recordings: {first.bag} differs by "
        f"{100.0 * first.share_of_torque:.3g} % of the torque at {first.joint} "
        f"({first_of(causes, _MOST_NUMBERS)}){_and_more(differing, 'recording')}; {rest}"
    )


def parametric_cause(data: Baseline, cause: Cause, effect: ParametricEffect) -> str:
    """Which parameters are in error, by how much, and what correcting them takes of the gap."""
    joint = cause.joint
    place = f"{joint}{effect.which(data.joints.index(joint))}" if joint else None
    # Of a cause of no single joint all: one for each joint.
    most = None if joint else len(cause.parameters)
    size = listed_numbers(cause.effect, cause.parameters, most)
    text = (
        f"{placed(cause.effect, place)} differs from the nominal model, "
        f"{likely(cause.probability)}: {size}"
    )
    if "mass" in cause.parameters and cause.parameters["mass"].value < 0.0:
        text += " (negative: a part that the nominal model has is not mounted)"
    smaller = [change for change in cause.joint_gaps if change.share_of_torque > 0.0]
    if smaller:
        largest = max(smaller, key=lambda change: change.share_of_torque)
        text += (
            f"; correcting it reduces the torque gap at {largest.joint} from {largest.before:.3g} "
            f"to {torque(data, largest.after, largest.joint)} "
            f"({100.0 * largest.share_of_torque:.3g} % of its torque)"
            f"{_and_more(smaller, 'joint', ' at')}"
        )
    return text + or_else(cause.indistinguishable_from)


def friction_not_given(data: Baseline, space: ParameterSpace) -> str:
    """Joints of whose friction the nominal model says nothing; empty where there is none."""
    bare = sorted(joint for kind, joint in space.not_given if kind == "Fc")
    joints = ", ".join(data.joints[joint] for joint in bare)
    return joints and (
        f"the nominal model has no dry friction at {joints}, and every drive has some: friction "
        "there is taken from the recording, whatever else is compared"
    )


def reversals(configuration: Configuration, data: Baseline) -> str:
    """Whether rows beside a reversal count, and why; empty where the user decides it.

    `configuration`: as the user gave it.
    """
    given = configuration.processing.reversal_margin
    proposed = data.prepared.configuration.processing.reversal_margin
    margin = REVERSAL_MARGIN if proposed is None else proposed
    counting = margin < REVERSAL_MARGIN
    if given is not None and (data.sticking or not counting):
        return ""
    which, why = "count", "the closed loop is simulated, which shows where joints stick"
    if not data.sticking or not counting:
        which = "count with the sign of the speed" if counting else "do not count"
        reason = "the closed loop is not simulated"
        if data.estimate.failures:
            reason = f"the closed loop cannot be simulated: {data.estimate.failures[0]}"
        elif configuration.controller.type == "unknown":
            reason = "the control law is not configured, and none that was fitted is simulated"
        why = f"it is not known where joints stick, for {reason}"
    origin = "proposed" if given is None else "configured"
    return f"rows beside a reversal {which} (processing.reversal_margin {margin:g} {origin}): {why}"


def beyond_the_law(
    data: Baseline, joint: int, beyond: float, command: float, events: Sequence[LawEvent]
) -> str:
    """What a joint's commands hold `beyond` the law and its changes, rms, N m (N).

    `command`: rms of the command. `events`: the largest first; empty where it acts all the time.
    """
    unit = data.unit_at(joint, "N m")
    text = (
        f"the commands of {data.joints[joint]} hold {beyond:.3g} {unit} rms "
        f"beyond the control law ({100.0 * beyond / max(command, 1e-300):.0f} % of the command)"
    )
    shown = ", ".join(
        f"{event.size:+.3g} {unit} from {event.begin:.2f} to {event.end:.2f} s of "
        f"{data.prepared.recordings[event.recording].path.name}"
        for event in events[:MOST_EVENTS]
    )
    more = len(events) - MOST_EVENTS
    text += shown and f", most of it {shown}{f' and {more} more times' if more > 0 else ''}"
    return f"{text}: no change of a gain or feedforward explains it"


def transmission(measured: Transmission, effect: str = "") -> str:
    """All that encoders before and behind a gear say of it, or of an effect that they measure."""
    what, unit = f"gear of {measured.joint}", f"m{measured.unit}"
    if effect:
        what = f"{spaced(effect)} at {measured.joint}, measured by the encoder behind the gear"
    if measured.time_offset is None:
        return f"{what}: {measured.reason}"
    least, most = measured.stiffness_at_least, measured.backlash_at_most
    if measured.stiffness is not None:
        damping = measured.damping and f", damping {with_interval(measured.damping)}"
        text = f"stiffness {with_interval(measured.stiffness)}{damping or ''}"
    else:
        text = f"no stiffness is measured, {measured.reason}"
        if least is not None and least < _RIGID:
            text += f" (95 %: at least {least:.2g} {'N m/rad' if unit == 'mrad' else 'N/m'})"
    if measured.backlash is not None:
        text += f"; play {with_interval(measured.backlash, 1e3, unit)}"
    elif most is not None:
        text += f"; no play is seen, at most {1e3 * most:.2g} {unit} (95 %)"
    else:
        text += "; play cannot be determined, the load hardly changes its side"
    if measured.lost_motion is not None:
        text += (
            f"; {with_interval(measured.lost_motion, 1e3, unit)} follow the direction of motion "
            "(play that friction keeps on one side, or friction behind the gear)"
        )
    if measured.position_error:
        text += "; an error of an encoder over the position was taken out"
    late, offset = "late" if measured.time_offset.value >= 0.0 else "early", measured.time_offset
    size = with_interval(replace(offset, value=abs(offset.value)), 1e3, "ms")
    return f"{what}: {text}; the link is read {size} {late}, which is no elasticity"


def remaining_parameter_errors(
    data: Baseline, errors: Sequence[ParameterError], hints: Sequence[Hint]
) -> str:
    """Parameter errors that no cause names, and what they may be; empty where there are none."""
    if not errors:
        return ""
    worst, numbers = errors[0], [h for h in hints if BY_NAME[h.effect].kind == "parametric"]
    which = " or ".join(placed(number.effect, number.joint, "at") for number in numbers)
    perhaps = f"perhaps {which}" if which else "no given number stands out"
    return (
        f"remaining parameter error: {torque(data, worst.remaining, worst.joint)} at {worst.joint} "
        f"({100.0 * worst.share_of_torque:.3g} % of its torque)"
        f"{_and_more(errors, 'joint', ' at')}: {perhaps}"
    )


def unexplained_residual(data: Baseline, lacking: Sequence[tuple[int, float, float, float]]) -> str:
    """Joints at which the last model misses much: (joint, rms, share of the torque, noise)."""
    if not lacking:
        return ""
    number, rms, share, noise = lacking[0]
    joint, unit = data.joints[number], data.unit_at(number, "N m")
    return (
        f"unexplained residual: {rms:.3g} {unit} at {joint} ({100 * share:.0f} % of its torque, "
        f"noise {noise:.2g} {unit}){_and_more(lacking, 'joint', ' at')}; the causes are not the "
        "whole gap there"
    )


def nonparametric(data: Baseline, term: Term) -> str:
    """What a function that is no effect of the catalogue describes, and where."""
    joint, effect = term.place.joint, term.effect
    if not isinstance(effect, Nonparametric):
        name = spaced(effect.name)
        return f"{data.joints[joint]}: a torque like that of {name}, which it cannot be (see hints)"
    text, shape = f"{data.joints[joint]}: a torque that {effect.words}", term.shape
    if isinstance(shape, StopShape):
        side = "above" if shape.side > 0 else "below"
        text += f", {side} {shape.position:.3g} {data.unit_at(joint, 'rad')}"
    return text


def small_nonparametric(data: Baseline, term: Term) -> str:
    """What such a function describes where it is too small to matter."""
    share = 100.0 * float(term.visible[term.place.joint])
    return f"{nonparametric(data, term)}: {share:.3g} % of its torque, too small to matter"


def events(
    data: Baseline,
    joint: int,
    share: float,
    largest: tuple[int, float],
    every: Sequence[tuple[int, float]],
) -> str:
    """Short events that hold a share of a residual's energy.

    `largest`, `every`: (recording, s since its start) of the largest sample; of all events, the
    largest first.
    """
    bags = [part.bag for part in data.prepared.session.parts]
    text = (
        f"{data.joints[joint]}: {100 * settings.EVENT_SAMPLES:g} % of the samples hold "
        f"{100 * share:.0f} % of the residual's energy, the largest in {bags[largest[0]]} "
        f"{largest[1]:.1f} s after its start"
    )
    if len(every) > 1:
        shown = sorted(every[:MOST_EVENTS])
        times = ", ".join(f"{time:.1f} s of {bags[recording]}" for recording, time in shown)
        text += f"; {len(every)} pulses, the strongest at {times}"
    return text


def summary(sentences: Sequence[str]) -> str:
    """Join the first of some sentences, as many as a reader takes in (`WORDS_OF_SUMMARY`).

    `sentences`: the weightiest first; empty ones are left out. What does not fit stands in the
    tables.
    """
    text = ""
    for sentence in filter(None, sentences):
        if not text or len(f"{text} {sentence}".split()) <= settings.WORDS_OF_SUMMARY:
            text = f"{text} {as_sentence(sentence)}".strip()
    return text


def largest_gap(gaps: Sequence[JointGap], model: str) -> str:
    """Where the gap beyond the noise is largest; empty where no joint has one."""
    worst = max(gaps, key=lambda gap: gap.share, default=None)
    if worst is None or not worst.beyond_noise_percent:
        return ""
    noise = " beyond noise" * (worst.noise_floor is not None)
    return (
        f"the {model} misses {worst.beyond_noise_percent:.3g} % of the torque{noise} at "
        f"{worst.joint}, where the gap is largest"
    )


def left_out(reasons: Mapping[str, str]) -> str:
    """Joints that say nothing, and why the first of them does not; `reasons`: by joint."""
    if not reasons:
        return ""
    first = next(iter(reasons.values()))
    return f"{', '.join(reasons)} {'is' if len(reasons) == 1 else 'are'} left out: {first}"


def nothing_explains(*, remaining: bool) -> str:
    """No cause; `remaining`: parameter errors are left that no cause names."""
    rest = "" if remaining else ": the rest is noise, or too small for these recordings to show"
    return f"no effect of the catalogue explains more of it than chance{rest}"


def further_causes(causes: Sequence[Cause]) -> str:
    """Causes after the first in a few words each."""
    listed = [
        f"{placed(cause.effect, cause.joint, 'at')} "
        f"({listed_numbers(cause.effect, cause.parameters, 1)}; {likely(cause.probability)})"
        for cause in causes[:_MOST_CAUSES]
    ]
    more = len(causes) - len(listed)
    if more > 0:
        listed.append(f"{more} smaller {'cause' if more == 1 else 'causes'} in the table")
    return f"besides: {', '.join(listed)}" if listed else ""


def too_unsure(probability: float, times: str) -> str:
    """Why something that may be a cause is none; `times`: in how many folds it is chosen."""
    return (
        f"its probability is {100.0 * probability:.0f} %, and the search without a part of the "
        f"time chooses it in {times} cases"
    )


def not_in_catalogue(unexplained: Unexplained | None, hints: Sequence[Hint]) -> str:
    """What no effect of the catalogue is like, or what it may be; empty where there is nothing."""
    if unexplained is None:
        return ""
    text = unexplained.where
    if unexplained.family != "event":  # of events `where` says the share
        text += f"; it explains {100 * unexplained.share:.0f} % of the refit's residual there"
    likeliest = unexplained.likeliest(hints)
    if likeliest is None:
        return f"not in the catalogue: {text}"
    odds = f"{100.0 * (likeliest.probability or 0.0):.0f} %"
    return f"no cause is certain there: {text}; it may be {spaced(likeliest.effect)} ({odds})"


def next_step(causes: Sequence[Cause], *, unknown: bool, remaining: bool) -> str:
    """What to do with the answer; `remaining`: parameter errors are left that no cause names."""
    if unknown:
        return "next: look at where the residual lies, or record a motion that excites it more"
    if causes:
        text = "next: put the causes into the simulator (idim-iv export)"
        apart = ", or record the motion that the report names, which tells them apart"
        return text + apart * any(cause.indistinguishable_from for cause in causes)
    return remaining * (
        "next: put the estimates into the simulator (idim-iv export --remainder changes the "
        "numbers that the recording asks for, --refit all of them)"
    )


def as_sentence(text: str) -> str:
    """Return a text with its first letter large and a full stop."""
    return f"{text[:1].upper()}{text[1:].rstrip('.')}."


def or_else(others: Sequence[Indistinguishable]) -> str:
    """What a cause may be as well, with the weight of each in the set."""
    listed = ", ".join(
        f"{placed(other.effect, other.joint)} ({100.0 * other.weight:.0f} %)" for other in others
    )
    return listed and f"; this recording cannot exclude {listed}"


def torque(data: Baseline, value: float, joint: str) -> str:
    """A torque of a joint with its unit."""
    return f"{value:.3g} {data.unit_at(data.joints.index(joint), 'N m')}"


def listed_numbers(
    effect: str, parameters: Mapping[str, EffectParameter], most: int | None = None
) -> str:
    """A few parameters with their intervals, those that are surest of the fitted."""
    shown = surest(parameters, _MOST_NUMBERS if most is None else most)
    words = (f"{parameter_words(effect, name)} {with_interval(p)}" for name, p in shown.items())
    return ", ".join(words)


def with_interval(parameter: EffectParameter, scale: float = 1.0, unit: str = "") -> str:
    """A number with its 95 % interval, in another unit if that is given."""
    text = f"{scale * parameter.value:.3g}"
    if parameter.std is not None:
        text += f" ± {settings.NORMAL_95 * scale * parameter.std:.2g}"
    return f"{text} {unit or parameter.unit}".rstrip()


def _and_more(listed: Sequence[object], what: str, at: str = "") -> str:
    """How many there are beyond the first; empty where there are none."""
    more = len(listed) - 1
    return f" and{at} {more} more {what}{'' if more == 1 else 's'}" if more > 0 else ""


def spaced(name: str) -> str:
    """A name of the catalogue in words."""
    return name.replace("_", " ")


def placed(effect: str, joint: str | None, at: str = "of") -> str:
    """An effect and its joint, if it has one."""
    return f"{spaced(effect)} {at} {joint}" if joint else spaced(effect)
