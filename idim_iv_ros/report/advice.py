"""The first screen in words: the verdict in two short sentences, and what to do next."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import get_args

from idim_iv_ros.diagnosis.result import Cause, GapResult, RecordingAgreement, Unexplained
from idim_iv_ros.effects.registry import part_of
from idim_iv_ros.encoding import shell_command
from idim_iv_ros.excitation.segments import separating_motion
from idim_iv_ros.identification.result import IMPOSSIBLE, IdentificationResult
from idim_iv_ros.report.changes import RECORDING, ChangedValue, changed_values
from idim_iv_ros.report.gap_words import effect_at, effect_words
from idim_iv_ros.report.numerals import known, measured, percent, round_number
from idim_iv_ros.report.section import R, Report
from idim_iv_ros.statistics.verdict import Verdict

# Badge of each verdict on an identification: class, sign; in the order of `Verdict`.
_BADGES = dict(
    zip(get_args(Verdict), (("good", "✓"), ("fair", "≈"), ("bad", "✕"), ("open", "?")), strict=True)
)
FAMILIES = {
    "velocity": "follows the speed",
    "position": "follows the position",
    "load": "follows the load",
    "time": "follows the time",
    "frequency": "follows the frequency",
    "event": "comes in single events",
}
_MOST_STEPS = 3
_FEW_VALUES = 3  # of the URDF in one step


@dataclass(frozen=True)
class Step:
    """One thing to do.

    Attributes
    ----------
    words : str
        An imperative.
    code : str
        The command to run, or what to write into which file; may have several lines.
    """

    words: str
    code: str


def verdict_badge(verdict: str) -> tuple[str, str, str]:
    """Return the verdict of an identification as a badge: class, sign, words."""
    return (*_BADGES.get(verdict, ("open", "?")), verdict)


def diagnosis_headline(result: GapResult) -> tuple[str, str]:
    """Return how large the gap is and what causes it: two sentences, 30 words together."""
    apart = [each for each in result.recordings if each.differences]
    if apart:
        return _disagreement(apart)
    worst = max(result.joint_gaps, key=lambda each: each.share, default=None)
    given = any(stage.name == "given" for stage in result.stages)
    model = "nominal model" if given else "refitted model"
    if worst is None:
        return f"The gap of the {model} could not be judged at any joint.", _cause_words(result, "")
    size = (
        f"The {model} misses {percent(worst.relative_percent, 3)} of the torque at {worst.joint}."
    )
    return size, _cause_words(result, _corrected(result, worst.joint))


def _disagreement(apart: Sequence[RecordingAgreement]) -> tuple[str, str]:
    """Which recordings are of another robot, as it were, and by what."""
    first = apart[0]
    more = f", {len(apart) - 1} more do too" if len(apart) > 1 else ""
    by = effect_at(first.differences[0].effect, first.differences[0].joint)
    return (
        f"The recordings disagree: {first.bag} differs by "
        f"{percent(100.0 * first.share_of_torque, 2)} of the torque at {first.joint}{more}.",
        f"What differs: {by}.",
    )


def _cause_words(result: GapResult, corrected: str) -> str:
    if result.causes:
        first = result.causes[0]
        more = len(result.causes) - 1
        others = f", with {more} more" if more else ""
        return f"Main cause: {effect_at(first.effect, first.joint)}{others}{corrected}."
    if result.unexplained is not None:
        what = FAMILIES[result.unexplained.family]
        return f"No effect of the catalogue explains it: the residual {what}."
    if result.verdict == "none":
        return "No cause was found: what remains is noise, or too small for this recording."
    if result.verdict == "parametric":
        return f"Its parameters are in error; which of them is inconclusive{corrected}."
    return "Its cause is inconclusive on this recording."


def _corrected(result: GapResult, joint: str) -> str:
    """What all corrections together take of the gap at a joint, on held-out data."""
    if len(result.stages) < 2:
        return ""
    first, last = (result.stages[k].torque_rms.get(joint) for k in (0, -1))
    if first is None or last is None or not (known(first) and known(last)) or last >= first:
        return ""
    return f"; the extended model removes {percent(100.0 * (1.0 - last / first))} of it"


def identification_headline(result: IdentificationResult) -> tuple[str, str]:
    """Return whether to believe the parameters and how well they fit: 30 words together."""
    colour = verdict_badge(result.verdict.verdict)[0]
    wrong = [each.joint for each in result.residuals if verdict_badge(each.verdict)[0] == "bad"]
    believed = {
        "good": "The parameters and their standard deviations may be believed.",
        "fair": "The parameters may be believed, with their refined standard deviations.",
        "bad": f"Do not rely on all parameters: the model is misspecified at {_listed(wrong)}.",
        "open": "Whether the parameters may be believed is inconclusive: see each joint below.",
    }[colour]
    fit = result.fit
    error = percent(fit.relative_error_percent, 3)
    state = "" if result.converged else " The iteration has not converged."
    return believed, f"The model misses {error} of the torque.{state}"


def _listed(joints: Sequence[str], most: int = 3) -> str:
    if not joints:
        return "several joints together"
    more = f" and {len(joints) - most} more" if len(joints) > most else ""
    return ", ".join(joints[:most]) + more


def identification_steps(report: Report[IdentificationResult]) -> list[Step]:
    """Return what to do after an identification, the most important first."""
    result, config = report.result, report.config
    colour = verdict_badge(result.verdict.verdict)[0]
    bags = [bag.path for bag in result.bags]
    steps = []
    if colour == "bad":
        command = _command("diagnose", *bags, "--config", config, "--out", "why")
        steps.append(Step("Look for the effect that the model lacks:", command))
    if result.processing.advice:
        advice = result.processing.advice[0]
        steps.append(Step(f"Follow the advice on {config}, then identify again:", advice))
    if not result.converged:
        words = f"Check the control law and the nominal model in {config}: no convergence."
        steps.append(Step(words, _command("check", *bags, "--config", config)))
    if any(IMPOSSIBLE in (p.remark, p.essential_remark) for p in result.parameters) or (
        colour == "open"
    ):
        command = _command("excite", "--config", config, "--out", "motion")
        steps.append(Step("Record a motion that shows all parameters:", command))
    if colour in ("good", "fair"):
        steps += _value_steps(report, changed_values(result, report.nominal))
        command = _command("diagnose", *bags, "--config", config, "--out", "why")
        steps.append(Step("See what the nominal model lacks, and why:", command))
    if len(steps) == 1:
        command = _command("excite", "--config", config, "--out", "motion")
        steps.append(Step("Record another motion and identify again:", command))
    return steps[:_MOST_STEPS]


def diagnosis_steps(report: Report[GapResult]) -> list[Step]:
    """Return what to do after a diagnosis: at most two corrections, then what to record."""
    result = report.result
    apart = [each.bag for each in result.recordings if each.differences]
    if apart:
        return _steps_of_disagreement(result, apart, report.config)
    values = changed_values(result, report.nominal)
    steps: list[Step] = []
    structural = [each for each in result.causes if each.kind == "structural"]
    seen: set[str] = set()
    for cause in result.causes:
        group = "structural" if _simulated(cause) else cause.effect
        if group in seen:
            continue
        seen.add(group)
        if group == "structural":
            steps.append(_structural_step([e for e in structural if _simulated(e)], report.config))
        else:
            steps += _parametric_step(cause.effect, report, values)
    if not result.causes and result.verdict == "parametric":
        steps += _value_steps(report, values)
    recording = _recording_step(result, report.config)
    if steps:
        return [*steps[: _MOST_STEPS - 1], recording]
    if result.verdict == "none":
        command = _command("identify", *result.bags, "--config", report.config, "--out", "results")
        return [Step("See how well each parameter is known:", command), recording]
    command = _command("check", *result.bags, "--config", report.config)
    return [Step("Look for gaps and clipped efforts in the recordings:", command), recording]


def _steps_of_disagreement(result: GapResult, apart: Sequence[str], config: str) -> list[Step]:
    """Take the recordings that agree by themselves, and each other one."""
    together = [bag for bag in result.bags if bag not in apart]
    first = _command("diagnose", *together, "--config", config, "--out", "agreeing")
    second = _command("diagnose", apart[0], "--config", config, "--out", "differing")
    return [
        Step("Diagnose the recordings that agree by themselves:", first),
        Step(f"Diagnose {apart[0]} by itself, and compare:", second),
    ]


def _simulated(cause: Cause) -> bool:
    """Whether it is an effect to add to the simulator."""
    return cause.kind == "structural" and part_of(cause.effect) != "gains"


def _structural_step(causes: Sequence[Cause], config: str) -> Step:
    names = _listed([effect_at(each.effect, each.joint, each.other_joint) for each in causes])
    words = f"Add {names} to your simulator; this simulates the robot with the values found:"
    command = _command("simulate", "--config", config, "--effects", "gap.json", "--out", "new.mcap")
    return Step(words, command)


def _parametric_step(
    effect: str, report: Report[GapResult], values: Sequence[ChangedValue]
) -> list[Step]:
    """What to write where for all causes of one effect."""
    result, config, urdf = report.result, report.config, report.nominal.urdf
    causes = [each for each in result.causes if each.effect == effect]
    sources = {f"cause: {effect_at(effect, each.joint)}" for each in causes}
    rows = [row for row in values if row.source in sources and row.key]
    places = _listed([each.joint for each in causes if each.joint] or ["all joints"])
    part = part_of(effect)
    if part in ("drive", "friction") and rows and report.nominal.is_mjcf:
        words = f"Set the {effect_words(effect)} of {places} in {urdf}, joint by joint:"
        return [Step(words, _assignments(rows))]
    if part == "drive" and rows:
        return [Step(f"Set the drive inertia of {places} in {config}:", _armature(result, rows))]
    if part == "offset":
        numbers = "\n".join(
            f"{each.joint}: {_value(p.value, p.std, p.unit)}"
            for each in causes
            for p in each.parameters.values()
        )
        return [Step(f"Subtract the constant torque of {places} in your simulator:", numbers)]
    if part == "friction" and rows:
        return [Step(f"Set the friction of {places} in {urdf}:", _dynamics(rows))]
    if part == "load" and rows:
        code = _assignments(rows)
        return [Step(f"Add a link for the payload at {places} to {urdf}:", code)]
    files = {row.file for row in rows}
    if not rows:
        numbers = "\n".join(
            f"{name.replace('_', ' ')} = {_value(each.value, each.std, each.unit)}"
            for name, each in list(causes[0].parameters.items())[:_FEW_VALUES]
        )
        words = f"Correct the {effect_words(effect)} of {places} in the nominal model:"
        return [Step(words, numbers)]
    place = config if files == {"configuration"} else urdf
    return [Step(f"Correct the {effect_words(effect)} of {places} in {place}:", _assignments(rows))]


def _value_steps(report: Report[R], values: Sequence[ChangedValue]) -> list[Step]:
    """Significant changes of single elements and keys, as one step."""
    rows = [row for row in values if row.key and row.source == RECORDING and row.significant]
    if not rows:
        return []
    first = sorted(rows, key=lambda row: -abs(row.distance or 0.0))
    places = " and ".join(dict.fromkeys((report.config, report.nominal.urdf)))
    words = f"Write the new values into {places}, those farthest off first:"
    return [Step(words, _assignments(first))]


def _assignments(rows: Sequence[ChangedValue]) -> str:
    lines = [
        f"{row.key or row.words} = {_value(row.new, row.std, row.unit)}{_was(row)}"
        for row in rows[:_FEW_VALUES]
    ]
    more = len(rows) - _FEW_VALUES
    return "\n".join([*lines, *([f"… and {more} more below"] if more > 0 else [])])


def _was(row: ChangedValue) -> str:
    return "" if row.given is None else f"   (given: {round_number(row.given)})"


def _value(value: float, std: float | None, unit: str) -> str:
    text, half = measured(value, std)
    return " ".join(filter(None, (text, half, unit)))


def _armature(result: GapResult, rows: Sequence[ChangedValue]) -> str:
    """The whole list as it is written into the configuration, and the uncertain digits."""
    simulator = result.configuration.get("simulator")
    listed = simulator.get("armature") if isinstance(simulator, Mapping) else None
    values = [f"{each:.6g}" for each in listed] if listed else ["0.0"] * len(result.joints)
    for row in rows:
        joint = int(row.key.partition("[")[2].rstrip("]"))
        values[joint] = f"{row.new:.3g}"
    shown = ", ".join(
        f"{row.words.rpartition(' of ')[2]} {_value(row.new, row.std, row.unit)}"
        for row in rows[:_FEW_VALUES]
    )
    return f"simulator: {{armature: [{', '.join(values)}]}}   # {shown}"


def _dynamics(rows: Sequence[ChangedValue]) -> str:
    """The `<dynamics>` of each joint, with what it was."""
    by_joint: dict[str, list[ChangedValue]] = {}
    for row in rows:
        by_joint.setdefault(row.key.rpartition("/dynamics@")[0], []).append(row)
    lines = []
    for joint, values in list(by_joint.items())[:_FEW_VALUES]:
        new = " ".join(f'{row.key.rpartition("@")[2]}="{row.new:.3g}"' for row in values)
        was = ", ".join(round_number(row.given) for row in values if row.given is not None)
        lines.append(f"{joint}: <dynamics {new}/>{f'   (given: {was})' if was else ''}")
    more = len(by_joint) - _FEW_VALUES
    return "\n".join([*lines, *([f"… and {more} more below"] if more > 0 else [])])


def _recording_step(result: GapResult, config: str) -> Step:
    """What to record: to separate causes, to see what this recording cannot show, or to verify."""
    motion = _command("excite", "--for", "diagnosis", "--config", config, "--out", "motion")
    again = _command("diagnose", "NEW.mcap", "--config", config, "--out", "after")
    for cause in result.causes:
        for other in cause.indistinguishable_from:
            how = separating_motion(cause.effect, other.effect)
            pair = f"{effect_words(cause.effect)} from {effect_words(other.effect)}"
            if how.startswith("no motion"):
                continue
            if how:
                return Step(f"Record the motion that separates {pair}:", motion)
    if isinstance(result.unexplained, Unexplained):
        joint = result.unexplained.joint
        return Step(f"Watch {joint} while you record again; does the residual come back?", motion)
    if result.causes:
        return Step("Record again with the corrected model to see whether the gap is gone:", again)
    if result.not_testable:
        return Step("Record a motion that shows the effects this one cannot show:", motion)
    return Step("Record again where the simulator matters to you, and compare:", again)


def _command(*words: str) -> str:
    return f"idim-iv {shell_command(*words)}"
