"""Whether the recorded commands are those of the configured control law."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from idim_iv_ros.gap.baseline import Baseline
from idim_iv_ros.gap.effects.controller_mismatch import GROUPS, LAG, ControllerMismatch
from idim_iv_ros.gap.likelihood import Fit, JointData, Regression
from idim_iv_ros.gap.result import EffectParameter
from idim_iv_ros.signals import Motion
from idim_iv_ros.simulation import ControlLaw, control_law

FloatArray = NDArray[np.float64]

# Logarithm of the likelihood that a change must bring beyond its penalty.
LEAST_SUPPORT = 8.0
# Share of the energy of what the law leaves that a change must take.
LEAST_SHARE = 0.02
# Share of the torque that recorded and computed commands must differ by to matter.
LEAST_DIFFERENCE = 0.005
# Periods of the control: a shorter lag is how the command was sampled and recorded. That is the
# same for all joints; a joint that lags this many periods more than another is its controller's.
LONGEST_LAG, LARGEST_DIFFERENCE = 2.0, 0.5
# Of the limit, above which a command counts as limited.
_LIMITED = 0.98
_LEAST_ROWS = 50
# A change of a gain must be this many times what noise of the encoder makes of it.
_NOISE_MARGIN = 3.0


@dataclass(frozen=True)
class ControllerFinding:
    """One joint whose commands are not those of the law.

    Attributes
    ----------
    effect : ControllerMismatch
    joint : str
    parameters : dict of str to EffectParameter
        What the robot uses instead, of the groups that differ.
    statistic : float
        Twice the logarithm of the likelihood ratio.
    p_value : float
        With the choice among groups and joints paid for (Bonferroni).
    share : float
        Of the energy of recorded less computed command that the changes explain.
    before, after : float
        RMS of recorded less computed command, N m (N), low-passed as the regression.
    """

    effect: ControllerMismatch
    joint: str
    parameters: dict[str, EffectParameter]
    statistic: float
    p_value: float
    share: float
    before: float
    after: float


@dataclass(frozen=True)
class _Rows:
    """Decimated rows of one joint."""

    rest: FloatArray  # recorded less computed command
    constants: FloatArray  # one column for each recording
    rate: FloatArray  # of the computed command
    acceleration: FloatArray
    size: float  # rms of the recorded command
    groups: dict[str, FloatArray]
    noise: dict[str, float]  # share of each group's energy that noise of the encoder makes
    runs: tuple[slice, ...]


def why_not_checked(data: Baseline) -> str:
    """Say why the commands cannot be compared with a law; empty where they can."""
    if data.prepared.configuration.controller.type == "unknown":
        return "the configuration names no control law"
    if any(motion.signals.position_reference is None for motion in data.prepared.motions):
        return "a recording has no references"
    return ""


def controller_mismatch(data: Baseline) -> list[ControllerFinding]:
    """Compare the recorded efforts with the configured law on the measured motion.

    All samples count, also at reversals, except those at the torque limit. Constants and a lag
    of up to two periods of the control, common to all joints, are no mismatch. Empty where nothing
    can be compared (`why_not_checked`) or nothing differs.
    """
    if why_not_checked(data):
        return []
    configuration = data.prepared.configuration
    law = control_law(configuration.controller, len(data.joints))
    period = configuration.controller.period or 1.0 / data.prepared.motions[0].signals.rate
    choices = {}
    for joint in range(len(data.joints)):
        rows = _rows(data.prepared.motions, law, joint)
        if rows is not None:
            choices[joint] = _choice(rows, law, joint, period)
    longest = _longest_lag(list(choices.values()), period)
    found = [_finding(data, law, joint, choice, longest) for joint, choice in choices.items()]
    return [finding for finding in found if finding is not None]


def _rows(motions: Sequence[Motion], law: ControlLaw, joint: int) -> _Rows | None:
    effect = ControllerMismatch()
    tables, constants, runs, start = [], [], [], 0
    noise_energy, energy = np.zeros(len(GROUPS)), np.zeros(len(GROUPS))
    limit = _LIMITED * float(law.torque_limit[joint])
    for number, motion in enumerate(motions):
        signals = motion.signals
        parts = effect.parts(signals, law, joint)
        rest = signals.torque[:, joint] - parts.command
        groups = [parts.groups[name] for name in GROUPS]
        recorded = signals.torque[:, joint]
        table = np.column_stack([rest, parts.rate, parts.acceleration, recorded, *groups])
        table = motion.decimation.whole(table[motion.span])
        bad = ~signals.valid[:, joint] | (np.abs(signals.torque[:, joint]) >= limit)
        kept = _apart(bad[motion.span], motion)
        tables.append(table[kept])
        constants.append(np.full(int(kept.sum()), number))
        for first, last in _stretches(kept):
            runs.append(slice(start + first, start + last))
        start += int(kept.sum())
        energy += np.sum(table[kept][:, 4:] ** 2, axis=0)
        noise_energy += np.sum(_noise(motion, law, joint)[kept] ** 2, axis=0)
    if start < _LEAST_ROWS:
        return None
    table = np.concatenate(tables)
    which = np.concatenate(constants)
    used = np.unique(which)
    return _Rows(
        rest=table[:, 0],
        constants=(which[:, None] == used).astype(float),
        rate=table[:, 1],
        acceleration=table[:, 2],
        size=float(np.sqrt(np.mean(table[:, 3] ** 2))),
        groups={name: table[:, 4 + k] for k, name in enumerate(GROUPS)},
        noise=dict(zip(GROUPS, noise_energy / np.maximum(energy, 1e-300), strict=True)),
        runs=tuple(runs),
    )


@dataclass(frozen=True)
class _Choice:
    """Groups that one joint needs, and the fits without and with them; both with a lag."""

    rows: _Rows
    groups: tuple[str, ...]
    plain: Fit
    fit: Fit

    @property
    def changes(self) -> dict[str, tuple[float, float]]:
        return _changes(self.fit, self.groups, self.rows)


def _longest_lag(choices: Sequence[_Choice], period: float) -> float:
    """Lag up to which a joint's is no mismatch, s."""
    longest = LONGEST_LAG * period
    if len(choices) < 2:
        return longest
    common = max(min(choice.changes[LAG][0] for choice in choices), 0.0)
    return min(longest, common + LARGEST_DIFFERENCE * period)


def _apart(bad: NDArray[np.bool_], motion: Motion) -> NDArray[np.bool_]:
    """Decimated samples without a bad one near them, nor near the ends."""
    factor = motion.decimation.factor
    sums = np.concatenate([[0], np.cumsum(bad)])
    first = np.maximum(motion.decimation.kept - factor, 0)
    last = np.minimum(motion.decimation.kept + factor + 1, len(bad))
    kept = sums[last] == sums[first]
    kept[:2] = kept[-2:] = False
    return np.asarray(kept)


def _stretches(kept: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Places of contiguous rows among those that are kept."""
    places = np.flatnonzero(kept)
    if len(places) == 0:
        return []
    cuts = np.flatnonzero(np.diff(places) > 1) + 1
    edges = [0, *cuts.tolist(), len(places)]
    return list(pairwise(edges))


def _noise(motion: Motion, law: ControlLaw, joint: int) -> FloatArray:
    """What white noise of the encoder makes of each group, decimated (m, groups)."""
    signals = motion.signals
    span = motion.span
    deviation = np.std(signals.position[span, joint] - motion.position[span, joint])
    random = np.random.default_rng(0).normal(0.0, 1.0, signals.position.shape) * deviation
    still = np.zeros_like(random)
    alone = replace(signals, position=random, position_reference=still, velocity_reference=still)
    parts = ControllerMismatch().parts(alone, law, joint)
    table = np.column_stack([parts.groups[name] for name in GROUPS])[span]
    return motion.decimation.whole(table)


def _choice(rows: _Rows, law: ControlLaw, joint: int, period: float) -> _Choice:
    """Add the best group until none is worth it, and drop those that are not needed."""
    rows = _with_late_speed(rows, law, joint, LONGEST_LAG * period)
    plain = fit = _fit(rows, (), with_lag=True)
    chosen: tuple[str, ...] = ()
    while True:
        better = {}
        for name in GROUPS:
            if name in chosen or not _usable(rows.groups[name]):
                continue
            names = (*chosen, name)
            larger = _fit(rows, names, with_lag=True)
            certain = _certain(rows, law, joint, names, larger, period)
            if certain and _worth(rows, fit, larger):
                better[name] = larger
        if not better:
            break
        name = max(better, key=lambda each: better[each].log_likelihood)
        chosen, fit = (*chosen, name), better[name]
    for name in chosen:
        rest = tuple(other for other in chosen if other != name)
        smaller = _fit(rows, rest, with_lag=True)
        if not _worth(rows, smaller, fit):
            chosen, fit = rest, smaller
    return _Choice(rows, chosen, plain, fit)


def _finding(
    data: Baseline, law: ControlLaw, joint: int, choice: _Choice, longest: float
) -> ControllerFinding | None:
    rows, fit, base = choice.rows, choice.fit, choice.plain
    if _rms(_fit(rows, (), with_lag=False)) < LEAST_DIFFERENCE * rows.size:
        return None
    changes = choice.changes
    lag, deviation = changes.pop(LAG)
    if abs(lag) - 3.0 * deviation > longest:
        within = float(np.clip(lag, -longest, longest))
        short = replace(rows, rest=rows.rest + within * rows.rate)
        if _worth(rows, _fit(short, choice.groups, with_lag=False), fit):
            changes[LAG] = (lag, deviation)
            base = _fit(short, (), with_lag=False)
    if not changes:
        return None
    statistic = 2.0 * float(fit.log_likelihood - base.log_likelihood)
    tried = (len(GROUPS) + 1) * len(data.joints)
    before, after = _rms(base), _rms(fit)
    return ControllerFinding(
        effect=ControllerMismatch(),
        joint=data.joints[joint],
        parameters=ControllerMismatch().parameters(law, joint, changes),
        statistic=statistic,
        p_value=min(1.0, tried * float(stats.chi2.sf(statistic, len(changes)))),
        share=1.0 - (after / before) ** 2,
        before=before,
        after=after,
    )


def _with_late_speed(rows: _Rows, law: ControlLaw, joint: int, longest: float) -> _Rows:
    """Compute the command with a speed that is as late as the recording says.

    Speeds come from differences of positions: one to two periods late are no mismatch.
    """
    _, kd, _ = (float(gain[joint]) for gain in law.torque_gains)
    late = kd * rows.acceleration
    if kd <= 0.0 or not _usable(late):
        return rows
    name = "late speed"
    fit = _fit(replace(rows, groups={**rows.groups, name: late}), (name,), with_lag=True)
    lag, deviation = _changes(fit, (name,), rows)[name]
    if not 0.0 < lag < longest + 3.0 * deviation:
        return rows
    return replace(rows, rest=rows.rest - lag * late)


def _usable(column: FloatArray) -> bool:
    return bool(np.std(column) > 1e-12)


def _fit(rows: _Rows, names: Sequence[str], *, with_lag: bool) -> Fit:
    parts = [rows.constants]
    if with_lag:
        parts.append(-rows.rate[:, None])
    matrix = np.column_stack([*parts, *(rows.groups[name] for name in names)])
    joint = JointData(rows.rest, matrix, np.arange(matrix.shape[1]), rows.runs)
    return Regression((joint,), matrix.shape[1]).fit()


def _rms(fit: Fit) -> float:
    return float(np.sqrt(np.mean(fit.residuals[0] ** 2)))


def _worth(rows: _Rows, smaller: Fit, larger: Fit) -> bool:
    """Whether one number more is supported and takes enough of the energy."""
    gain = larger.log_likelihood - smaller.log_likelihood - 0.5 * float(np.log(len(rows.rest)))
    share = 1.0 - (_rms(larger) / max(_rms(smaller), 1e-300)) ** 2
    return bool(gain >= LEAST_SUPPORT and share >= LEAST_SHARE)


def _changes(fit: Fit, names: Sequence[str], rows: _Rows) -> dict[str, tuple[float, float]]:
    """(value, std) of each group and of the lag."""
    constants = rows.constants.shape[1]
    deviations = np.sqrt(np.diag(fit.covariance))
    values = zip(fit.values[constants:], deviations[constants:], strict=True)
    return {
        name: (float(value), float(std))
        for name, (value, std) in zip((LAG, *names), values, strict=True)
    }


def _certain(
    rows: _Rows, law: ControlLaw, joint: int, names: Sequence[str], fit: Fit, period: float
) -> bool:
    """Whether the last change is larger than what noise and sampling make of the law."""
    name = names[-1]
    change = abs(_changes(fit, names, rows)[name][0])
    kp, kd, _ = (float(gain[joint]) for gain in law.torque_gains)
    floor: Mapping[str, float] = {
        "kp": _NOISE_MARGIN * rows.noise["kp"] * kp,
        # A speed that is one period old looks like this much less of its gain.
        "kd": _NOISE_MARGIN * rows.noise["kd"] * kd + period * kp,
    }
    return change > floor.get(name, 0.0)
