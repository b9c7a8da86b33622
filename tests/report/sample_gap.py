"""Diagnoses as they come out of real recordings, made without one."""

from dataclasses import replace
from typing import Literal

import numpy as np
from scipy.signal import lfilter

from idim_iv_ros.diagnosis.result.causes import (
    Cause,
    Evidence,
    Gap,
    Hint,
    Indistinguishable,
    SimulationGap,
    Unexplained,
)
from idim_iv_ros.diagnosis.result.document import (
    GapResult,
    GapSeries,
    JointGap,
    NotTestable,
    Regime,
    Stage,
    TrackingSeries,
    Where,
)
from idim_iv_ros.diagnosis.result.recordings import (
    ContrastCause,
    ContrastResult,
    JointContrast,
    JointTorque,
)
from idim_iv_ros.effects.cause import EffectParameter
from idim_iv_ros.types import FloatArray

Case = Literal["none", "parametric", "structural", "both", "unknown"]
CASES: tuple[Case, ...] = ("none", "parametric", "structural", "both", "unknown")

NOISE, STEP = 0.21, 0.02
_AXES = {
    "speed": ("rad/s", 0.0, 0.05),
    "direction": ("", -1.0, 0.0),
    "position": ("rad", -0.6, 0.4),
    "load": ("N m", 15.0, np.inf),
    "time": ("s", 20.0, 40.0),
    "reversal": ("rad", 0.002, 0.02),
}


def sample_gap(
    joints: int = 2,
    case: Case = "structural",
    *,
    given: bool = True,
    floor: bool = True,
    tracking: bool = True,
    seconds: float = 60.0,
    first: str = "joint_1",
) -> GapResult:
    """Return a diagnosis of a robot with `joints` joints.

    Parameters
    ----------
    case
        Verdict: Stribeck friction at joint 2 and ripple at the last joint (structural), a payload
        (parametric), both, contact (unknown) or nothing.
    given, floor, tracking
        Whether there is a nominal model, a noise floor from repeats, a loop that can be simulated.
    first
        Name of the first joint.
    """
    names = (first, *(f"joint_{k + 1}" for k in range(1, joints)))
    random = np.random.default_rng(1)
    series = tuple(
        _series(k, names, case, given, int(seconds / STEP), random) for k in range(joints)
    )
    causes = _causes(names, case, given, floor, tracking)
    return GapResult(
        robot="arm2" if joints == 2 else f"arm{joints}",
        joints=names,
        joint_types=("revolute",) * joints,
        bags=("runs/session-1.mcap", "runs/session-2.mcap", "runs/session 3.mcap"),
        software={"idim_iv_ros": "0.1.0", "numpy": "2.1.0", "pin": "3.3.1"},
        configuration={"robot": {"joints": list(names)}, "signals": {"effort_unit": "N m"}},
        without=("spring",) if case == "unknown" else (),
        verdict=case,
        summary=_summary(case, names),
        causes=causes,
        hints=_hints(names) if case == "none" else (),
        unexplained=(
            Unexplained(
                names[-1], "event", 0.62, "pulses between 12 and 15 s that no repeat shows again"
            )
            if case == "unknown"
            else None
        ),
        where=Where(tuple(_joint_gap(joint, floor, series) for joint in series), _regimes(series)),
        findings=(
            f"{_second(names)}, below 0.05 rad/s: 61 % of the gap in 9 % of the samples",
            f"{names[-1]}, position 0.4 to 1.5 rad: 48 % of the gap in 31 % of the samples",
        ),
        not_testable=(
            NotTestable(
                "torque_saturation",
                None,
                "the torque stays below 34 % of the limit",
                "torques near the limit: a payload, or faster motion",
            ),
            NotTestable(
                "backlash",
                names[0],
                "the load never changes its sign",
                "creep and reversals where gravity changes its sign",
                "0.9 mrad",
            ),
        ),
        stages=_stages(names, case, given, tracking, series),
        series=series,
        tracking=_tracking(names, random) if tracking else (),
        notes=("One stage of joint_1 was re-linearised twice.",)
        + (() if tracking else ("The control law is unknown: no closed loop was simulated.",)),
        extended_parameters={
            "ZZ1": EffectParameter(1.2345, 0.0123, "kg m²"),
            "Fv2": EffectParameter(5.61, None, "N m s/rad"),
        },
        timing={"reading": 0.4, "refit": 2.2, "candidates": 7.1, "shrinkage": 3.3},
    )


def _second(names: tuple[str, ...]) -> str:
    """Joint 2, or the only one."""
    return names[:2][-1]


def _series(
    k: int, names: tuple[str, ...], case: Case, given: bool, rows: int, random
) -> GapSeries:
    time = STEP * np.arange(rows)
    phase = random.uniform(0.0, 2.0 * np.pi, 3)
    waves = ((0.9, 0.11 + 0.01 * k), (0.4, 0.43), (0.08, 1.9))
    q = sum(a * np.sin(2 * np.pi * f * time + p) for (a, f), p in zip(waves, phase, strict=True))
    v = np.gradient(q, STEP)
    load = 24.0 / (k + 1) * np.cos(q) + 1.3 / (k + 1) * np.gradient(v, STEP)
    torque = load + 6.0 * v + 8.0 * np.sign(v)
    noise = lfilter([NOISE * 0.8], [1.0, -0.6], random.normal(size=rows))
    refit = torque.copy()
    if case in ("structural", "both"):
        if names[k] == _second(names):
            torque = torque + 1.6 * np.sign(v) * (np.exp(-((v / 0.12) ** 2)) - 0.15)
        if k == len(names) - 1:
            torque = torque + 0.35 * np.sin(18.0 * q + 0.4)
    extended = torque.copy()
    if case == "unknown" and k == len(names) - 1:
        torque = torque + 2.5 * np.exp(-(((time % 15.0 - 13.0) / 0.4) ** 2))
    measured = torque + noise
    model = refit - (0.08 * load if case in ("parametric", "both") else 0.01 * load)
    turned = np.flatnonzero(np.diff(np.sign(v)) != 0)
    last = np.searchsorted(turned, np.arange(rows)) - 1
    since = np.abs(q - q[turned[np.maximum(last, 0)]])
    friction = 6.0 * v + 8.0 * np.sign(v) if given else None
    nominal = model if given else None
    torques = (measured, nominal, refit, extended, extended - load, friction)
    return GapSeries(names[k], time, *torques, q, v, load, since, STEP)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _gap(before: float, after: float, floor: float | None) -> Gap:
    share = (before - after) / (before - (floor or 0.0))
    return Gap(before, after, floor, share, (share - 0.06, min(1.0, share + 0.04)))


def _hints(names: tuple[str, ...]) -> tuple[Hint, ...]:
    reason = "a search without one fold finds it in only 2 of 5 folds"
    return (
        Hint(
            effect="time_delay",
            joint=names[0],
            sentence=f"time delay at {names[0]} (delay 0.4 ± 0.3 ms): only a hint, {reason}",
            reason=reason,
            parameters={"delay": EffectParameter(4e-4, 1.5e-4, "s")},
            chosen_in_folds="2 of 5",
            torque_gap=Gap(0.12, 0.118, None, 0.02, (-0.05, 0.06)),
        ),
    )


def _causes(
    names: tuple[str, ...], case: Case, given: bool, floor: bool, tracking: bool
) -> tuple[Cause, ...]:
    level = NOISE if floor else None
    moved = SimulationGap(4.1e-4, 1.5e-4, None, 0.634, (0.52, 0.71)) if tracking else None
    payload = Cause(
        effect="payload",
        kind="parametric",
        joint=None,
        parameters={
            "mass": EffectParameter(1.283, 0.021, "kg"),
            "centre_of_mass_x": EffectParameter(0.041, 0.003, "m"),
            "centre_of_mass_y": EffectParameter(-0.0007, 0.0031, "m"),
            "centre_of_mass_z": EffectParameter(0.102, 0.005, "m"),
        },
        evidence=Evidence(3127.4, 0.91, "6 of 6"),
        torque_gap=_gap(1.46, 0.27, level),
        simulation_gap=moved,
        sentence="All joints: the simulator lacks a payload of 1.28 ± 0.04 kg at the last link; "
        "with it the torque gap shrinks by 95 %.",
    )
    stribeck = Cause(
        effect="stribeck",
        kind="structural",
        joint=_second(names),
        parameters={
            "excess": EffectParameter(1.62, 0.07, "N m"),
            "speed": EffectParameter(0.121, 0.009, "rad/s"),
        },
        evidence=Evidence(611.2, 0.47, "6 of 6", "6 of 6"),
        indistinguishable_from=(
            Indistinguishable("presliding", _second(names), 0.3),
            Indistinguishable("time_delay", _second(names), 0.1),
        ),
        torque_gap=_gap(0.62, 0.225, level),
        simulation_gap=moved,
        sentence=f"{_second(names)}: friction rises by 1.6 N m below 0.12 rad/s.",
    )
    ripple = Cause(
        effect="position_ripple",
        kind="structural",
        joint=names[-1],
        parameters={
            "amplitude": EffectParameter(0.351, 0.012, "N m"),
            "wave_number_1": EffectParameter(18.02, 0.04, "1/rad"),
        },
        evidence=Evidence(208.0, 0.31, "5 of 6", "6 of 6"),
        torque_gap=_gap(0.33, 0.22, level),
        sentence=f"{names[-1]}: a torque ripple of 0.35 N m, 18 times a turn.",
    )
    structural = (stribeck, ripple)
    causes = {
        "none": (),
        "unknown": (),
        "parametric": (payload,),
        "structural": structural,
        "both": (payload, *structural),
    }
    return tuple(cause for cause in causes[case] if given or cause.kind == "structural")


def _summary(case: Case, names: tuple[str, ...]) -> str:
    ripple = f"a torque ripple at {names[-1]}"
    return {
        "none": "The refitted model leaves 0.21 N m, which is the noise floor of 0.21 N m.",
        "parametric": "The gap is a payload that the simulator lacks: 1.28 ± 0.04 kg.",
        "structural": f"The simulator lacks Stribeck friction at {_second(names)} and {ripple}.",
        "both": f"The simulator lacks a payload, friction at {_second(names)} and {ripple}.",
        "unknown": f"62 % of the residual energy at {names[-1]} comes in pulses: look for contact.",
    }[case]


def _joint_gap(series: GapSeries, floor: bool, everything: tuple[GapSeries, ...]) -> JointGap:
    def gap(joint: GapSeries) -> FloatArray:
        return joint.torque - (joint.refit if joint.given is None else joint.given)

    shares = {
        joint.joint: np.sum(gap(joint) ** 2) / np.sum(joint.torque**2) for joint in everything
    }
    share = shares[series.joint]
    return JointGap(
        series.joint,
        _rms(gap(series)),
        float(100.0 * np.sqrt(share)),
        float(share / sum(shares.values())),
        NOISE if floor else None,
        "repeats: 3 of the same motion" if floor else "lower bound: no motion was repeated",
    )


def _regimes(everything: tuple[GapSeries, ...]) -> tuple[Regime, ...]:
    return tuple(
        Regime(series.joint, axis, low, high, unit, 0.61, 0.09, 6.8, (5.4, 8.2))
        for series in everything
        for axis, (unit, low, high) in _AXES.items()
    )


def _stages(
    names: tuple[str, ...],
    case: Case,
    given: bool,
    tracking: bool,
    everything: tuple[GapSeries, ...],
) -> tuple[Stage, ...]:
    kinds = ["given"] if given else []
    if case in ("parametric", "both") and given:
        kinds.append("+payload")
    kinds.append("refit")
    if case in ("structural", "both"):
        kinds += [f"+stribeck[{_second(names)}]", f"+position_ripple[{names[-1]}]"]
    note = "" if tracking else "the control law is unknown"
    stages = []
    for place, kind in enumerate(kinds):
        rms = {}
        for series in everything:
            if kind == "given" and series.given is not None:
                rms[series.joint] = _rms(series.torque - series.given)
            elif place >= kinds.index("refit") + 1 and (
                series.joint != names[-1] or kind.startswith("+position")
            ):
                rms[series.joint] = _rms(series.torque - series.extended)
            else:
                rms[series.joint] = _rms(series.torque - series.refit)
        motion = {name: 4e-4 * rms[name] for name in names} if tracking else None
        ci95 = {name: (0.93 * value, 1.08 * value) for name, value in rms.items()}
        stages.append(Stage(kind, rms, ci95, motion, note))
    return tuple(stages)


def _tracking(names: tuple[str, ...], random) -> tuple[TrackingSeries, ...]:
    time = np.linspace(0.0, 20.0, 800)
    turning = np.sign(np.cos(0.7 * time))
    measured = 5e-4 * np.sin(1.3 * time) + 1e-4 * turning
    before = 4e-4 * np.sin(1.3 * time + 0.2)
    after = 4.9e-4 * np.sin(1.3 * time) + 0.9e-4 * turning
    return tuple(
        TrackingSeries(
            name, bag, time, measured + 2e-5 * random.normal(size=len(time)), before, after
        )
        for name in names
        for bag in ("session-1.mcap", "session-2.mcap")
    )


def sample_contrast() -> GapResult:
    """A load that the second set has."""
    result = sample_gap(2, "both")
    sentence = "What changed from the reference recordings to b1, b2: a payload of 0.81 kg."
    cause = ContrastCause(
        effect="payload",
        kind="parametric",
        joint="joint_2",
        change="changed",
        bags=("b1", "b2"),
        parameters={"mass": EffectParameter(0.81, 0.0102, "kg")},
        evidence=Evidence(900.0, chosen_in_folds="4 of 4"),
        indistinguishable_from=(Indistinguishable("link_inertia", "joint_2", 0.99),),
        torques=(JointTorque("joint_2", 1.2, 0.31), JointTorque("joint_1", 3.4, 0.2)),
        sentence="payload of joint_2 changed: mass 0.81 ± 0.02 kg",
    )
    contrast = ContrastResult(
        reference=("a",),
        against=("b1", "b2"),
        differs=True,
        sentence=sentence,
        joints=(
            JointContrast("joint_1", 3.4, 0.13, 0.13, 0.2, 0.0),
            JointContrast("joint_2", 1.2, 0.04, 0.04, 0.31, 0.0),
        ),
        causes=(cause,),
        common=("stribeck at joint_1",),
        notes=("the effort acts 0.5 ms after its stamp",),
    )
    return replace(result, contrast=contrast, summary=f"{sentence} By itself: {result.summary}")
