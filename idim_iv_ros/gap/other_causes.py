"""Causes that are not in the refit's residual: wrong numbers, and another control law."""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.gap.baseline import Baseline
from idim_iv_ros.gap.controller_check import ControllerFinding
from idim_iv_ros.gap.joint_units import in_units_of, unit_at
from idim_iv_ros.gap.noise_floor import NoiseFloor
from idim_iv_ros.gap.parametric_evidence import ParametricCause
from idim_iv_ros.gap.result import Cause, EffectParameter, Evidence, Gap


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
            indistinguishable_from=cause.rivals,
            torque_gap=_parametric_gap(data, cause, floors),
            simulation_gap=None,
            sentence=_parametric_sentence(cause),
        )
        for cause in found
    ]


def controller_results(data: Baseline, findings: Sequence[ControllerFinding]) -> list[Cause]:
    """One cause for each joint whose commands are not those of the configured law."""
    return [_controller_cause(data, finding) for finding in findings]


def _controller_cause(data: Baseline, finding: ControllerFinding) -> Cause:
    joint = data.joints.index(finding.joint)
    parameters = in_units_of(data, joint, finding.parameters)
    unit = unit_at(data, joint, "N m")
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
            f"{_numbers(parameters)} by {finding.after:.3g} {unit}"
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


def _parametric_sentence(cause: ParametricCause) -> str:
    most = 4 if cause.joint else len(cause.parameters)  # one for each joint
    text = (
        f"{cause.effect.subject(cause.joint)}: {_numbers(cause.parameters, most)}; this takes "
        f"{100.0 * cause.share:.0f} % of the energy of the given model's gap"
    )
    if cause.rivals:
        others = ", ".join(
            rival.effect.replace("_", " ") + (f" of {rival.joint}" if rival.joint else "")
            for rival in cause.rivals
        )
        text += f"; these recordings cannot tell it from {others}"
    return text


def _numbers(parameters: dict[str, EffectParameter], most: int = 4) -> str:
    """The first parameters with their intervals, in words."""
    shown = []
    for name, parameter in list(parameters.items())[:most]:
        text = f"{name.replace('_', ' ')} {parameter.value:.3g}"
        if parameter.std is not None:
            text += f" ± {1.96 * parameter.std:.2g}"
        shown.append(f"{text} {parameter.unit}".rstrip())
    return ", ".join(shown)
