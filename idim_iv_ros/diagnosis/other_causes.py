"""Causes that are not in the refit's residual: wrong numbers, and another control law."""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.controller.check import ControllerFinding
from idim_iv_ros.diagnosis.joint_units import in_units_of, unit_at
from idim_iv_ros.diagnosis.localisation.where import signed_share
from idim_iv_ros.diagnosis.parameter_words import parameter_words, surest
from idim_iv_ros.diagnosis.parametric.evidence import ParametricCause
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.noise_floor import NoiseFloor
from idim_iv_ros.diagnosis.result import Cause, EffectParameter, Evidence, Gap, JointChange
from idim_iv_ros.effects.link_inertia import LinkInertia


def parametric_results(
    data: Baseline, found: Sequence[ParametricCause], floors: Sequence[NoiseFloor]
) -> list[Cause]:
    """One cause for each wrong part of the given numbers."""
    return [
        Cause(
            effect=cause.effect.name,
            kind="parametric",
            joint=cause.joint,
            other_joint=None,
            parameters=cause.parameters,
            evidence=Evidence(cause.statistic, cause.p_value, None, ""),
            indistinguishable_from=cause.indistinguishable_from,
            torque_gap=_parametric_gap(data, cause, floors),
            simulation_gap=None,
            sentence=_parametric_sentence(data, cause),
            joint_gaps=_joint_gaps(data, cause),
        )
        for cause in found
    ]


def _joint_gaps(data: Baseline, cause: ParametricCause) -> tuple[JointChange, ...]:
    """Joints whose gap the cause changes, its own first and then the largest share first."""
    changed = [
        JointChange(name, float(before), float(after), signed_share(before, after, size))
        for name, before, after, size in zip(
            data.joints, cause.before, cause.after, cause.sizes, strict=True
        )
    ]
    kept = [
        each
        for each in changed
        if each.joint == cause.joint or abs(each.share_of_torque) >= settings.LEAST_PARAMETER_ERROR
    ]
    return tuple(sorted(kept, key=lambda each: (each.joint != cause.joint, -each.share_of_torque)))


def controller_results(data: Baseline, findings: Sequence[ControllerFinding]) -> list[Cause]:
    """One cause for each joint whose commands are not those of the configured law."""
    return [_controller_cause(data, finding) for finding in findings]


def _controller_cause(data: Baseline, finding: ControllerFinding) -> Cause:
    joint = data.joints.index(finding.joint)
    parameters = in_units_of(data, joint, finding.parameters)
    unit = unit_at(data, joint, "N m")
    numbers = _numbers(finding.effect.name, parameters, settings.MOST_NUMBERS_IN_SENTENCE)
    return Cause(
        effect=finding.effect.name,
        kind="structural",
        joint=finding.joint,
        other_joint=None,
        parameters=parameters,
        evidence=Evidence(finding.statistic, finding.p_value, None, ""),
        indistinguishable_from=(),
        torque_gap=Gap(
            finding.before, finding.after, None, 1.0 - finding.after / finding.before, None
        ),
        simulation_gap=None,
        sentence=(
            f"another control law than configured at {finding.joint}: recorded and computed "
            f"commands differ by {finding.before:.3g} {unit}, with "
            f"{numbers} by {finding.after:.3g} {unit}"
        ),
    )


def _parametric_gap(data: Baseline, cause: ParametricCause, floors: Sequence[NoiseFloor]) -> Gap:
    which = range(len(data.joints))
    if cause.joint is not None:
        which = range(data.joints.index(cause.joint), data.joints.index(cause.joint) + 1)
    before = float(np.sqrt(np.sum(cause.before[list(which)] ** 2)))
    after = float(np.sqrt(np.sum(cause.after[list(which)] ** 2)))
    levels = [floors[joint].sigma for joint in which]
    known = [level for level in levels if level is not None]
    floor = float(np.sqrt(np.sum(np.square(known)))) if len(known) == len(levels) else None
    room = before - (floor or 0.0)
    shrinkage = (before - after) / room if room > 1e-3 * before else None
    return Gap(before, after, floor, shrinkage, None)


def _parametric_sentence(data: Baseline, cause: ParametricCause) -> str:
    place = cause.joint or ""
    if cause.joint and cause.effect.name == LinkInertia.name:
        place += f" (link {data.joints.index(cause.joint) + 1})"
    # Of a cause of no single joint all: one for each joint.
    most = settings.MOST_NUMBERS_IN_SENTENCE if cause.joint else len(cause.parameters)
    numbers = _numbers(cause.effect.name, cause.parameters, most)
    text = f"{cause.effect.subject(place)}: {numbers}"
    mass = cause.parameters.get("mass")
    if mass is not None and mass.value < 0.0:
        text += " (negative: a part that the nominal model has is not mounted)"
    smaller = [each for each in _joint_gaps(data, cause) if each.share_of_torque > 0.0]
    if smaller:
        gaps = ", ".join(_gap_words(data, each) for each in smaller)
        text += f"; correcting it takes the torque gap {gaps}"
    if cause.indistinguishable_from:
        others = ", ".join(
            rival.effect.replace("_", " ") + (f" of {rival.joint}" if rival.joint else "")
            for rival in cause.indistinguishable_from
        )
        text += f"; this recording cannot tell it from {others}"
    return text


def _gap_words(data: Baseline, each: JointChange) -> str:
    unit = unit_at(data, data.joints.index(each.joint), "N m")
    share = f"{100.0 * each.share_of_torque:.2g} % of its torque"
    return f"at {each.joint} from {each.before:.3g} to {each.after:.3g} {unit} ({share})"


def _numbers(
    effect: str,
    parameters: dict[str, EffectParameter],
    most: int,
) -> str:
    """A few parameters with their intervals, in words, those that are surest of the fitted."""
    shown = []
    for name, parameter in surest(parameters, most).items():
        text = f"{parameter_words(effect, name)} {parameter.value:.3g}"
        if parameter.std is not None:
            text += f" ± {settings.NORMAL_95 * parameter.std:.2g}"
        shown.append(f"{text} {parameter.unit}".rstrip())
    return ", ".join(shown)
