"""Text of the first screen of a report: the verdict in two short sentences, and the next steps."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.diagnosis.result.causes import Cause, Gap, Unexplained
from idim_iv_ros.diagnosis.result.document import GapResult, JointGap
from idim_iv_ros.diagnosis.result.recordings import ContrastCause, ContrastResult
from idim_iv_ros.diagnosis.sentences import left_out
from idim_iv_ros.effects.cause import EffectParameter, surest
from idim_iv_ros.effects.registry import parameter_words, part_of
from idim_iv_ros.errors import first_of
from idim_iv_ros.excitation.diagnosis import separating_motion
from idim_iv_ros.files import GAP, RESULT
from idim_iv_ros.identification.result import IMPOSSIBLE, IdentificationResult
from idim_iv_ros.report import gap_words
from idim_iv_ros.report.numerals import (
    INTERVAL,
    MISSING,
    THIN,
    is_interval,
    is_number,
    number,
    percent,
    plural,
    sentence,
    with_interval,
)
from idim_iv_ros.report.section import Files, Report

# Badge of each verdict on an identification: CSS class, sign, words.
BADGES = {
    "valid": ("good", "✓", "valid"),
    "autocorrelated": ("fair", "≈", "autocorrelated"),
    "misspecified": ("bad", "✕", "misspecified"),
    "inconclusive": ("open", "?", "inconclusive"),
}
FAMILIES = {
    "velocity": "follows the speed",
    "position": "follows the position",
    "load": "follows the load",
    "time": "follows the time",
    "frequency": "follows the frequency",
    "event": "comes in single events",
}
_MOST_STEPS = 3


@dataclass(frozen=True)
class Step:
    """One recommended step: a sentence, and a command to run or a line to write into a file."""

    words: str
    code: str


def diagnosis_headline(result: GapResult) -> tuple[str, ...]:
    """Return sentences on the size of the gap, its main cause, and how certain that is.

    Joints that say nothing come first: all else is of the others.
    """
    gaps = [gap for gap in result.where.joints if gap.joint not in result.left_out]
    worst = max(gaps, key=lambda gap: gap.share, default=None)
    given = any(stage.name == "given" for stage in result.stages)
    model = "nominal model" if given else "refitted model"
    out = (sentence(left_out(result.left_out)),) if result.left_out else ()
    size, certainty = f"The gap of the {model} could not be judged at any joint.", ""
    if worst is not None:
        size = f"The {model} misses {_share_missed(worst)} at {worst.joint}."
        certainty = _certainty(result, worst)
    said = (size, _cause_words(result, worst), certainty)
    return *_disagreement(result), *out, *filter(None, said)


def _share_missed(gap: JointGap) -> str:
    beyond, noise = gap.beyond_noise_percent, "" if gap.noise_floor is None else " beyond noise"
    if beyond == 0.0:
        return f"nothing{noise}"
    size = "more than all" if beyond is not None and beyond > 100.0 else percent(beyond, 3)
    return f"{size} of the torque{noise}"


def _disagreement(result: GapResult) -> tuple[str, ...]:
    """Return which recordings differ from the others, and by which effect; empty if none."""
    apart = [recording for recording in result.recordings if not recording.agrees]
    if not apart:
        return ()
    first = max(apart, key=lambda recording: recording.share_of_torque)
    more = f", and {len(apart) - 1} more" if len(apart) > 1 else ""
    difference = first.differences[0]
    size = _size_words(difference.effect, difference.parameters)
    by = ", ".join(filter(None, (gap_words.effect_at(difference.effect, difference.joint), size)))
    used = plural(len(result.bags), "recording")
    means = len(result.bags) == len(result.recordings)
    return (
        f"The recordings disagree: {first.bag} differs by {by} "
        f"({percent(100.0 * first.share_of_torque, 2)} of the torque at {first.joint}){more}.",
        "All other numbers are means." if means else f"All else is of {used} that agree.",
    )


def difference_rows(result: GapResult) -> list[tuple[str, str, str]]:
    """Return rows on recordings that differ from the others: its name, effect and joint, size."""
    rows = []
    for recording in result.recordings:
        for difference in recording.differences:
            size = _size_words(difference.effect, difference.parameters) or MISSING
            where = gap_words.effect_at(difference.effect, difference.joint)
            rows.append((recording.bag, where, size))
    return rows


def _cause_words(result: GapResult, gap: JointGap | None) -> str:
    """Return a sentence on the main cause, and how much of the worst joint's gap is corrected."""
    corrected, worst = ("", None) if gap is None else (_corrected_share(result, gap), gap.joint)
    if result.causes:
        causes = _first_words(result.causes)
        everywhere = any(cause.joint is None for cause in result.causes)
        places = {place for cause in result.causes for place in (cause.joint, cause.other_joint)}
        places |= {change.joint for cause in result.causes for change in cause.joint_gaps}
        if worst is None or everywhere or worst in places:
            return f"Main cause: {causes}{corrected}."
        if any(error.joint == worst for error in result.parameter_errors):
            return f"Wrong parameter values there{corrected}; besides them, {causes}."
        return f"Cause elsewhere: {causes}{corrected}."
    if result.unexplained is not None:
        what = FAMILIES[result.unexplained.family]
        likeliest = result.unexplained.likeliest(result.hints)
        if likeliest is not None:
            perhaps = gap_words.hint_words(likeliest)
            return f"No cause is certain: the residual {what}; perhaps {perhaps}."
        if result.unexplained.family == "event":
            return f"Nothing in the catalogue explains it: the residual {what}."
        return f"Not in the catalogue: {result.unexplained.where}."
    if result.verdict == "none":
        return "No cause was found: the rest is noise, or too small here."
    if result.verdict == "parametric":
        return f"Parameter values are wrong; this recording does not show which{corrected}."
    return "Its cause is inconclusive on this recording."


def _first_words(causes: Sequence[Cause | ContrastCause]) -> str:
    name, more = gap_words.effect_at(causes[0].effect, causes[0].joint), len(causes) - 1
    return f"{name}, with {more} more" if more else name


def _certainty(result: GapResult, worst: JointGap) -> str:
    """Return a sentence on the first cause's probability; without one, on the remaining gap."""
    if result.causes:
        first = result.causes[0]
        if first.probability is not None:
            return f"That cause is {gap_words.probability_words(first)} probable."
        size = _size_words(first.effect, first.parameters)
        return f"Its {size}." if size else ""
    last = result.stages[-1] if result.stages else None
    interval = None if last is None else last.torque_ci95.get(worst.joint)
    if last is None or not is_interval(interval):
        return ""
    unit = gap_words.torque_unit(result, worst.joint)
    level = f"{number(last.torque_rms[worst.joint])} {unit}"
    low, high = map(number, interval)
    noise = "" if worst.noise_floor is None else f"; noise: {number(worst.noise_floor)} {unit}"
    stage = gap_words.stage_words(last.name)
    return f"Held out, the {stage} leaves {level} ({low} to {high}, 95 %{noise})."


def _size_words(effect: str, parameters: Mapping[str, EffectParameter]) -> str:
    """Return the best determined number of an effect with its 95 % interval; empty without one.

    Numbers that differ significantly from zero come first.
    """
    numbers = {name: by for name, by in surest(parameters, 2).items() if by.std}
    clear = [name for name, by in numbers.items() if abs(by.value) > INTERVAL * (by.std or 0.0)]
    for name in (*clear, *numbers):
        by = numbers[name]
        return f"{parameter_words(effect, name)}: {with_interval(by.value, by.std, by.unit)} (95 %)"
    return ""


def _corrected_share(result: GapResult, gap: JointGap) -> str:
    """Return in brackets the share of a joint's gap beyond noise that all corrections remove."""
    if len(result.stages) < 2:
        return ""
    first, last = (result.stages[k].torque_rms.get(gap.joint) for k in (0, -1))
    if not (is_number(first) and is_number(last)):
        return ""
    shrinkage = Gap.between(first, last, gap.noise_floor).shrinkage
    if shrinkage is None or shrinkage <= 0.0:
        return ""
    return f" ({percent(100.0 * min(shrinkage, 1.0))} of it corrected)"


def identification_headline(result: IdentificationResult) -> tuple[str, ...]:
    """Return sentences: are the parameters valid, how well do they fit, how precise are they."""
    colour = BADGES[result.verdict.verdict][0]
    wrong = [one.joint for one in result.residuals if BADGES[one.verdict][0] == "bad"]
    where = first_of(wrong, 3) or "several joints together"
    believed = {
        "good": "The parameters and their standard deviations may be believed.",
        "fair": "The parameters may be believed, with their refined standard deviations.",
        "bad": f"Do not rely on all parameters: the model is misspecified at {where} "
        f"(tested at {percent(100.0 * result.instruments.alpha)}).",
        "open": "Whether the parameters may be believed could not be tested"
        + ("." if _has_reference(result) else ": no reference of the motion was recorded."),
    }[colour]
    error = percent(result.fit.relative_error_percent, 3)
    state = "" if result.converged else " The iteration has not converged."
    percents = (p.relative_std_percent for p in result.parameters if p.essential)
    sizes = list(filter(is_number, percents))
    said = believed, f"The model misses {error} of the torque.{state}"
    if not sizes or colour == "bad":
        return said
    half = percent(INTERVAL * float(np.median(sizes)))
    known_well = (
        f"Half of the {len(sizes)} essential parameters are known within ±{THIN}{half} (95 %)."
    )
    return *said, known_well


def _has_reference(result: IdentificationResult) -> bool:
    signals = result.configuration.get("signals")
    return isinstance(signals, Mapping) and signals.get("reference") is not None


def identification_steps(report: Report[IdentificationResult]) -> list[Step]:
    """Return the recommended steps after an identification, the most important first."""
    result, files, config = report.result, report.files, report.files.config
    colour = BADGES[result.verdict.verdict][0]
    bags = [bag.path for bag in result.bags]
    diagnosis = files.command("diagnose", *bags, out="why")
    motion = files.command("excite", out="motion")
    steps = []
    if colour == "bad":
        steps.append(Step("Look for the effect that the model lacks:", diagnosis))
    if result.processing.advice:
        advice = result.processing.advice[0]
        steps.append(Step(f"Follow the advice on {config}, then identify again:", advice))
    if not result.converged:
        words = f"Check the control law and the nominal model in {config}: no convergence."
        steps.append(Step(words, files.command("check", *bags)))
    if colour == "open" and not _has_reference(result):
        words = f"Record the references, too (signals.reference in {config}), and identify again:"
        steps.append(Step(words, files.command("record", out="bags")))
    shows_little = any(IMPOSSIBLE in (p.remark, p.essential_remark) for p in result.parameters)
    if shows_little or colour == "open":
        steps.append(Step("Record a motion that shows all parameters:", motion))
    if colour in ("good", "fair"):
        values = files.command("export", files.here(RESULT), out="simulator")
        steps.append(Step("Put the new values into your simulator:", values))
        steps.append(Step("See what the nominal model lacks, and why:", diagnosis))
    if len(steps) == 1 and steps[0].code != motion:
        steps.append(Step("Record another motion and identify again:", motion))
    return steps[:_MOST_STEPS]


def export_options(result: GapResult) -> tuple[str, ...]:
    """Return the options with which an export of a diagnosis changes all that it shows."""
    # Beside a torque scale or gravity the export cannot spread what no cause names.
    parts = {part_of(cause.effect) for cause in result.causes}
    spread = gap_words.unnamed_error(result) and not parts & {"torque scale", "gravity"}
    return ("--remainder",) if spread or not result.causes else ()


def diagnosis_steps(report: Report[GapResult]) -> list[Step]:
    """Return the recommended steps after a diagnosis: what to run, and what to record."""
    result, config, files = report.result, report.files.config, report.files
    bags = files.recordings(result.bags)
    laws = [cause for cause in result.causes if part_of(cause.effect) == "gains"]
    if len(laws) < len(result.causes):
        rest = export_options(result)
        what = "the causes and the other values into" if rest else "the causes into"
        words = f"Put {what} your simulator{':' if rest else ', or into ours:'}"
        steps = [Step(words, files.command("export", files.here(GAP), *rest, out="simulator"))]
    elif laws:
        steps = []
    elif result.verdict == "parametric":
        words = "Put the numbers that the recording asks for into your simulator:"
        line = files.command("export", files.here(GAP), "--remainder", out="simulator")
        steps = [Step(words, line)]
    elif result.verdict == "none":
        line = files.command("identify", *bags, out="results")
        steps = [Step("See how well each parameter is known:", line)]
    else:
        words = f"Check the recordings, and units, signs and zero positions in {config}:"
        steps = [Step(words, files.command("check", *bags))]
    if laws:
        steps.append(Step(f"Correct the control law in {config}:", "\n".join(map(_law, laws))))
    apart = [one.bag for one in result.recordings if one.bag not in result.bags]
    if apart:
        others = files.recordings(apart)
        line = files.command("diagnose", *bags, "--against", *others, out="changes")
        steps.append(Step(f"See what changed in {', '.join(apart)}:", line))
    return [*steps, _recording_step(result, files)]


def _law(cause: Cause) -> str:
    numbers = ", ".join(
        f"{name.replace('_', ' ')} = {with_interval(by.value, by.std, by.unit)}"
        for name, by in cause.parameters.items()
    )
    return f"{cause.joint}: {numbers}"


def _recording_step(result: GapResult, files: Files) -> Step:
    """Return which motion to record: to separate causes, to test more effects, or to verify."""
    motion = _motion(files)
    repeat = files.again("diagnose", out="after")
    separating = _separating_steps(result.causes, files)
    if separating:
        return separating[0]
    if isinstance(result.unexplained, Unexplained):
        joint = result.unexplained.joint
        return Step(f"Watch {joint} while you record again; does the residual come back?", motion)
    if result.causes:
        return Step("Record again with the corrected model to see whether the gap is gone:", repeat)
    if result.not_testable:
        return Step("Record a motion that shows the effects this one cannot show:", motion)
    return Step("Record again where the simulator matters to you, and compare:", repeat)


def contrast_headline(contrast: ContrastResult) -> list[str]:
    """Return sentences on what changed between two sets, by how much, and how certain that is."""
    apart = list(map(sentence, contrast.not_compared))
    if contrast.causes:
        first = contrast.causes[0]
        changed = f"From the reference to the second set changed: {_first_words(contrast.causes)}."
        sizes = [_size_words(first.effect, first.parameters)]
        for torque in first.torques[:1]:
            part = percent(100.0 * torque.share_of_torque)
            sizes.append(f"{part} of the torque at {torque.joint}")
        words = [changed, sentence(", ".join(filter(None, sizes)))]
        for rival in first.indistinguishable_from[:1]:
            weight = percent(100.0 * rival.weight)
            words.append(f"Or else: {gap_words.effect_at(rival.effect, rival.joint)} ({weight}).")
        return words + apart
    if contrast.differs:
        widest = max(contrast.joints, key=lambda joint: joint.share_of_torque)
        share = percent(100.0 * widest.share_of_torque)
        return [f"The sets differ by {share} of the torque at {widest.joint}, and nothing in the "
                "catalogue explains it.", *apart]  # fmt: skip
    return [contrast.sentence]


def contrast_steps(contrast: ContrastResult, files: Files) -> list[Step]:
    """Return the recommended steps after a comparison of two sets of recordings."""
    reference, against = files.recordings(contrast.reference), files.recordings(contrast.against)
    if contrast.not_compared:
        line = files.command("check", *against)
        return [Step("Check the recordings of the second set, and their units and signs:", line)]
    if not contrast.differs:
        line = files.command("diagnose", *reference, *against, out="both")
        return [Step("Diagnose all recordings together, which shows more:", line)]
    line = files.command("diagnose", *against, out="after")
    if not contrast.causes:
        return [Step("See what the second set lacks by itself:", line)]
    where = gap_words.effect_at(contrast.causes[0].effect, contrast.causes[0].joint)
    first = Step(f"Look at the robot ({where}); diagnose the second set for its values:", line)
    return [first, *_separating_steps(contrast.causes, files)]


def _separating_steps(causes: Sequence[Cause | ContrastCause], files: Files) -> list[Step]:
    """Return a step to record the motion that separates two indistinguishable causes, if any."""
    for cause in causes:
        for other in cause.indistinguishable_from:
            how = separating_motion(cause.effect, other.effect)
            if how and not how.startswith("no motion"):
                pair = " from ".join(map(gap_words.effect_words, (cause.effect, other.effect)))
                return [Step(f"Record the motion that separates {pair}:", _motion(files))]
    return []


def _motion(files: Files) -> str:
    return files.command("excite", "--for", "diagnosis", out="motion")
