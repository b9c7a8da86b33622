"""Identification results as they come out of real recordings, made without one."""

import functools
import itertools
from typing import Literal

import numpy as np
from scipy.signal import lfilter

from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.identification.result import (
    BagSummary,
    Fit,
    IdentificationResult,
    InstrumentReport,
    JointResidual,
    JointSeries,
    JointTests,
    ParameterEstimate,
    ProcessingSummary,
    Refined,
    RefinedEstimate,
)
from idim_iv_ros.recording.recording import ClockQuality, Note
from idim_iv_ros.statistics.hypothesis import HypothesisTest
from idim_iv_ros.statistics.residuals import ResidualDiagnosis, diagnose_residual
from idim_iv_ros.statistics.verdict import judge_all, judge_joint

Case = Literal["white", "coloured", "rejected", "untested"]

WALD, EXOGENOUS = "the instruments are valid (Π = I)", "the regressor is exogenous (γ = 0)"
_KINDS = (
    ("XX", "kg m²", 0.4, "XX{0} − YY{0} + YY{1} + 2·d{1}·MZ{1} + d{1}²·(M{1} + M{2})"),
    ("XY", "kg m²", 0.02, "XY{0} − d{1}·MX{1}"),
    ("XZ", "kg m²", 0.16, "XZ{0} − r{1}·MX{1}"),
    ("YZ", "kg m²", 0.01, "YZ{0}"),
    ("ZZ", "kg m²", 1.09, "ZZ{0} + Ia{0} + YY{1} + d{1}²·M{1} + d{1}²·M{2}"),
    ("MX", "kg m", 2.21, "MX{0} + d{1}·(M{1} + M{2})"),
    ("MY", "kg m", 0.08, "MY{0} − MZ{1}"),
    ("Fv", "N m s/rad", 5.68, "Fv{0}"),
    ("Fc", "N m", 7.77, "Fc{0}"),
    ("off", "N m", 0.3, "off{0}"),
)


@functools.cache
def sample_result(
    joints: int = 6, case: Case = "coloured", *, first: str = "joint_1"
) -> IdentificationResult:
    """Return a result of a robot with `joints` joints; the last two are fine when rejected."""
    names = (first, *(f"joint_{k + 1}" for k in range(1, joints)))
    random = np.random.default_rng(1)
    series, residuals = [], []
    for name in names:
        one, diagnosis = _joint(name, case, random)
        series.append(one)
        residuals.append(diagnosis)
    tests = _tests(names, case)
    verdicts = tuple(judge_joint(t, r) for t, r in zip(tests[1:], residuals, strict=True))
    parameters = _parameters(joints, random)
    untested = case == "untested"
    accepted = [test.accepted for test in tests[1:]]
    return IdentificationResult(
        robot="staubli_tx40",
        joints=names,
        joint_types=("revolute",) * joints,
        effort_unit="N m",
        bags=(_bag(joints),),
        software={"python": "3.11.2", "idim-iv-ros": "0.1.0", "numpy": "2.1.3", "pin": "3.8.0"},
        configuration={
            "robot": {"urdf": "/work/tx40.urdf", "joints": list(names), "gravity": [0, 0, -9.81]},
            "controller": {"type": "pd", "kp": [6000.0] * joints, "kd": [250.0] * joints},
            "identification": {"significance": 0.05},
        },
        estimator="idim-ls" if untested else "idim-iv",
        iterations=1 if untested else 3,
        converged=True,
        convergence_note="MX4 moved last, by 0.42 % (tolerance 1 %)",
        parameters=parameters,
        covariance=np.diag([parameter.std**2 for parameter in parameters]),
        instruments=InstrumentReport(
            source="closed-loop simulation with the fitted control law",
            accepted=None if None in accepted else all(accepted),
            alpha=0.05,
            failures=()
            if untested
            else (
                "closed-loop simulation from the given values: diverged after 0.31 s at joint_2",
            ),
            notes=() if untested else ("gains scaled by 1, 1.32, 0.871",),
            tests=tests,
        ),
        specification=JointTests(alpha=0.05, tests=_specification(names, case)),
        exogeneity=JointTests(alpha=0.05, tests=_exogeneity(names, case)),
        residuals=tuple(
            JointResidual(**vars(residual), verdict=joint.verdict, sentence=joint.sentence)
            for residual, joint in zip(residuals, verdicts, strict=True)
        ),
        verdict=judge_all(verdicts, tests[0]),
        fit=Fit(
            relative_error_percent=6.4387,
            ls_relative_error_percent=6.4112,
            condition_number=187.3,
            samples=sum(len(joint.time) for joint in series),
            base_parameters=len(parameters),
            essential_parameters=sum(p.essential for p in parameters),
            essential_p_value=0.3127,
        ),
        processing=ProcessingSummary(
            position_cutoff=50.0,
            position_order=4,
            decimation_cutoff=20.0,
            decimation_factors=(100,),
            row_rate=50.0,
            minimum_speed=(0.0213,) * joints,
            reasons=(
                "position cut-off 50 Hz proposed: the measured motion stands above the position "
                "noise up to 51.3 Hz",
                "decimation cut-off 20 Hz proposed: 0.4 of the position cut-off, the paper's ratio",
            ),
        ),
        controller=("joint_1: kp 5987 ± 12, kd 249 ± 2, R² = 0.998",),
        fitted_gains=(),
        refined=_refined(parameters, residuals) if case == "coloured" else None,
        series=tuple(series),
        timing={"reading": 0.4123, "model": 0.21, "filtering": 0.05, "estimation": 3.217},
    )


def _joint(
    name: str, case: Case, random: np.random.Generator
) -> tuple[JointSeries, ResidualDiagnosis]:
    """A sweep of 18 s at 50 Hz with its reversals left out."""
    time = np.arange(900) / 50.0
    frequency, phase = random.uniform(0.3, 0.7), random.uniform(0.0, 6.0)
    speed = np.cos(2 * np.pi * frequency * time + phase)
    kept = np.abs(speed) > 0.06
    speed, time = speed[kept], time[kept]
    columns = np.column_stack(
        [speed, np.sign(speed), np.sin(2.2 * time + phase), np.gradient(speed, time)]
    )
    beta = np.array([5.0, 7.0, 12.0, 2.0]) * random.uniform(0.3, 1.5)
    noise = random.normal(size=len(time)) * 0.05 * np.abs(beta).sum()
    if case in ("coloured", "rejected"):
        noise = lfilter([0.5], [1.0, -1.1, 0.4], noise)
    torque = columns @ beta + noise
    cuts = np.flatnonzero(np.diff(time) > 0.03) + 1
    bounds = [0, *cuts, len(time)]
    runs = tuple(slice(a, b) for a, b in itertools.pairwise(bounds))
    rows = JointRows(columns, torque, np.arange(4), runs, name)
    return JointSeries(name, time, torque, columns @ beta), diagnose_residual(rows, beta)


def _tests(names: tuple[str, ...], case: Case) -> tuple[HypothesisTest, ...]:
    if case == "untested":
        reason = "IDIM-LS uses no instruments"
        return tuple(HypothesisTest.not_run(WALD, scope, reason) for scope in ("all", *names))
    tests = []
    for index, name in enumerate(("all", *names)):
        wrong = case == "rejected" and index <= max(1, len(names) - 2)
        tests.append(
            HypothesisTest(
                WALD,
                name,
                412.3381 if wrong else 1.0434,
                60 if name == "all" else 13 + index,
                4761 if name == "all" else 801,
                3.2e-88 if wrong else 0.0731 + 0.1 * index,
                0.4128 if wrong else 0.01872,
                torque_deviation_percent=18.31 if wrong else 0.1374,
            )
        )
    return tuple(tests)


def _exogeneity(names: tuple[str, ...], case: Case) -> tuple[HypothesisTest, ...]:
    if case == "untested":
        return _tests(names, case)
    tests = [
        HypothesisTest(EXOGENOUS, name, 2.714, 14, 788, 0.00071, None) for name in ("all", *names)
    ]
    reason = "the instruments reproduce the regressor, which is exogenous"
    tests[-1] = HypothesisTest.not_run(EXOGENOUS, names[-1], reason)
    return tuple(tests)


def _specification(names: tuple[str, ...], case: Case) -> tuple[HypothesisTest, ...]:
    tests = []
    for name in names:
        for family in ("position", "acceleration", "speed"):
            scope, null = f"{name}: {family}", f"nothing of the {family} is left in the residual"
            if case == "untested":
                tests.append(HypothesisTest.not_run(null, scope, "IDIM-LS uses no instruments"))
            else:
                p_value = 2.1e-31 if case == "rejected" and family == "position" else 0.231
                tests.append(
                    HypothesisTest(
                        null, scope, 1.873, 15, 781, p_value, torque_deviation_percent=1.214
                    )
                )
    return tuple(tests)


def _parameters(joints: int, random: np.random.Generator) -> tuple[ParameterEstimate, ...]:
    parameters = []
    for joint in range(joints):
        for kind, unit, size, expression in _KINDS:
            value = size * random.choice([-1.0, 1.0]) * random.uniform(0.3, 1.3) / (1 + joint)
            if kind in ("Fv", "Fc"):
                value = abs(value)
            poor = kind in ("XY", "YZ", "MY", "off")
            std = abs(value) * random.uniform(0.2, 1.5) if poor else 0.03 * size / (1 + joint)
            essential = not poor
            friction = kind in ("Fv", "Fc", "off")
            parameters.append(
                ParameterEstimate(
                    name=f"{kind}{joint + 1}",
                    expression=expression.format(joint + 1, joint + 2, joint + 3),
                    unit=unit,
                    value=value,
                    std=std,
                    white_std=std / 2.3,
                    essential=essential,
                    essential_value=value + 0.3 * std if essential else None,
                    essential_std=0.9 * std if essential else None,
                    ls_value=value - 1.4 * std,
                    ls_std=std,
                    ordinary_ls_value=value - 2.0 * std,
                    given_value=0.0 if friction else value * random.uniform(0.7, 1.2),
                )
            )
    return tuple(parameters)


def _refined(
    parameters: tuple[ParameterEstimate, ...], residuals: list[ResidualDiagnosis]
) -> Refined:
    return Refined(
        ar_orders=tuple(residual.ar_order for residual in residuals),
        parameters=tuple(
            RefinedEstimate(
                name=p.name,
                expression=p.expression,
                unit=p.unit,
                value=p.value + 0.4 * p.std,
                std=0.8 * p.std,
                essential=p.essential,
                ls_value=p.ls_value,
                given_value=p.given_value,
            )
            for p in parameters
        ),
    )


def _bag(joints: int) -> BagSummary:
    return BagSummary(
        path="/work/recordings/2024-05-03/tx40_exciting_trajectory.mcap",
        rate=5000.0,
        duration=18.0,
        samples=90001,
        signals=("/joint_states position", "/joint_states effort", "/joint_reference position"),
        clocks=(
            ClockQuality("/joint_states", "header", 90001, 4999.7, 1.2e-5, 0.0041, 3, 2, 0),
            ClockQuality("/joint_reference", "arrival", 18000, 1000.2, 2.1e-4, 0.0312, 0, 0, 1),
        ),
        notes=(
            Note("/joint_states", "joints came in another order", 12),
            Note("/joint_states", "samples invented in gaps", 61),
            Note("/joint_reference", "no header stamps: arrival time is the clock", 1),
        ),
        dropped={
            "slower than the reversal speed": 41 * joints,
            "not measured": 3 * joints,
            "at the edges": 4 * joints,
        },
    )
