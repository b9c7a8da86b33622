"""Which given numbers are wrong: the change from the given to the fitted parameters."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from idim_iv_ros.gap.baseline import Baseline
from idim_iv_ros.gap.change_regression import ChangeRegression, Explained, change_regression
from idim_iv_ros.gap.effects.drive_inertia import DriveInertia
from idim_iv_ros.gap.effects.friction_level import FrictionLevel
from idim_iv_ros.gap.effects.gravity_direction import GravityDirection
from idim_iv_ros.gap.effects.link_inertia import LinkInertia
from idim_iv_ros.gap.effects.parametric_effect import Change, Estimated, ParametricEffect
from idim_iv_ros.gap.effects.payload import Payload
from idim_iv_ros.gap.effects.torque_gain import TorqueGain
from idim_iv_ros.gap.likelihood import Fit, Regression
from idim_iv_ros.gap.result import EffectParameter, Rival

FloatArray = NDArray[np.float64]

PARAMETRIC: tuple[ParametricEffect, ...] = (
    Payload(),
    GravityDirection(),
    TorqueGain(),
    FrictionLevel(),
    DriveInertia(),
    LinkInertia(),
)

# Share of the explainable change that the causes must explain together.
ENOUGH = 0.9
# Logarithm of the likelihood that a cause must bring beyond its penalty.
LEAST_SUPPORT = 8.0
# Causes that bring this much less are not better or worse.
ALIKE = 6.0
LEAST_CORRELATION = 0.5
# Share of the given model's gap that the refit must take; the second where structural effects
# were accepted, for what is left of them biases the refit.
LEAST_SHARE, LEAST_SHARE_BESIDE = 0.01, 0.05
# Share of the explainable change that each cause must bring.
LEAST_PART = 0.02
MOST_CAUSES = 6


@dataclass(frozen=True)
class ParametricCause:
    """One way in which the given numbers are wrong.

    Attributes
    ----------
    effect : ParametricEffect
    joint : str or None
        None where it belongs to none.
    parameters : dict of str to EffectParameter
        Those that the recording determines.
    statistic : float
        Wald statistic beside the other causes.
    p_value : float
        Of the statistic, with the choice among all causes paid for (Bonferroni).
    part : float
        Of the explainable change that this cause explains beside the others, 0 to 1.
    share : float
        Of the energy of the given model's gap that goes with it, each joint by its torque.
    before, after : (n_joints,)
        RMS of the residual with the causes before this one, and with it, N m (N).
    rivals : tuple of Rival
    """

    effect: ParametricEffect
    joint: str | None
    parameters: dict[str, EffectParameter]
    statistic: float
    p_value: float
    part: float
    share: float
    before: FloatArray
    after: FloatArray
    rivals: tuple[Rival, ...]


@dataclass(frozen=True)
class ParametricOutcome:
    """What is wrong with the given numbers.

    Attributes
    ----------
    causes : tuple of ParametricCause
        Strongest first; empty where nothing is wrong.
    statistic : float
        Wald statistic of the change of all base parameters; 0 without a given model.
    degrees : int
        Of freedom.
    p_value : float
    share : float
        Of the energy of the given model's gap that new base parameters take away.
    explained : float
        Of that change, by the causes together, less what noise would: about 0 to 1.
    complete : bool
        Whether the causes are enough: they explain ENOUGH, beyond noise.
    before, after : (n_joints,)
        RMS of the given model's residual, and with all causes, N m (N).
    reason : str
        Why there are no causes; empty otherwise.
    """

    causes: tuple[ParametricCause, ...]
    statistic: float
    degrees: int
    p_value: float
    share: float
    explained: float
    complete: bool
    before: FloatArray
    after: FloatArray
    reason: str


@dataclass(frozen=True)
class _Hypothesis:
    effect: ParametricEffect
    joint: int | None
    changes: tuple[Change, ...]

    @property
    def key(self) -> tuple[str, int | None]:
        return self.effect.name, self.joint


@dataclass(frozen=True)
class _Trial:
    hypothesis: _Hypothesis
    explained: Explained
    support: float

    @property
    def own(self) -> tuple[Estimated, ...]:
        return self.explained.found[-len(self.hypothesis.changes) :]

    @property
    def contribution(self) -> FloatArray:
        own = self.explained.contributions[:, -len(self.hypothesis.changes) :]
        return np.asarray(own.sum(axis=1))


def parametric_causes(
    data: Baseline,
    regression: Regression,
    fit: Fit,
    catalogue: Sequence[ParametricEffect] = PARAMETRIC,
) -> ParametricOutcome:
    """Find the smallest set of causes that explains the change of the given parameters.

    Parameters
    ----------
    data
    regression
        The extended one: accepted structural effects are its added columns
        (`Attribution.extended`, or `smooth_regression` where there are none).
    fit
        Of that regression.
    catalogue
    """
    if not data.prepared.model.robot.has_inertials:
        nothing = np.full(len(data.joints), np.nan)
        reason = "the URDF gives no inertia: there is no given model"
        return ParametricOutcome((), 0.0, 0, 1.0, 0.0, 0.0, False, nothing, nothing, reason)
    changes = change_regression(data, regression, fit)
    refit = changes.refit()
    whole = refit.contributions.sum(axis=1)
    share = changes.share(whole)
    p_value = float(stats.chi2.sf(refit.statistic, refit.rank))
    least = LEAST_SHARE_BESIDE if regression.added else LEAST_SHARE
    excess = refit.statistic - refit.rank
    before, _ = changes.rms(whole)
    if excess < least * changes.energy or share < least:
        found: list[_Hypothesis] = []
        reason = f"new parameters take {100.0 * max(share, 0.0):.2g} % of the gap's energy"
    else:
        found = _smallest(changes, refit, catalogue, len(data.joints))
        reason = "" if found else "no cause of the catalogue explains the change"
    explained = changes.explain([change for each in found for change in each.changes])
    part = (explained.statistic - explained.rank) / max(excess, 1.0)
    causes = _causes(data, changes, found, catalogue, excess)
    _, after = changes.rms(explained.contributions.sum(axis=1))
    return ParametricOutcome(
        causes=causes,
        statistic=refit.statistic,
        degrees=refit.rank,
        p_value=p_value,
        share=share,
        explained=part,
        complete=bool(found) and _enough(explained, refit),
        before=before,
        after=after,
        reason=reason,
    )


def _enough(explained: Explained, refit: Explained) -> bool:
    """Whether what is missing to ENOUGH may be noise."""
    free = max(refit.rank - explained.rank, 0)
    missing = refit.statistic - explained.statistic - free
    return bool(
        missing <= (1.0 - ENOUGH) * (refit.statistic - refit.rank) + 2.0 * np.sqrt(2.0 * free)
    )


def _hypotheses(
    changes: ChangeRegression, catalogue: Sequence[ParametricEffect]
) -> list[_Hypothesis]:
    space = changes.space
    return [
        _Hypothesis(effect, joint, tuple(variant))
        for effect in catalogue
        for joint in effect.places(space)
        for variant in effect.variants(space, joint)
    ]


def _trials(
    changes: ChangeRegression,
    kept: Sequence[_Hypothesis],
    catalogue: Sequence[ParametricEffect],
) -> list[_Trial]:
    """Each cause beside those that are kept, in its best variant; the best first."""
    before = [change for each in kept for change in each.changes]
    base = changes.explain(before)
    taken = {each.key for each in kept}
    best: dict[tuple[str, int | None], _Trial] = {}
    for hypothesis in _hypotheses(changes, catalogue):
        if hypothesis.key in taken:
            continue
        explained = changes.explain([*before, *hypothesis.changes])
        gain = 0.5 * (explained.statistic - base.statistic)
        numbers = explained.rank - base.rank
        support = gain - 0.5 * numbers * float(np.log(changes.rows))
        trial = _Trial(hypothesis, explained, support)
        if numbers == 0 or not hypothesis.effect.admissible(
            changes.space, hypothesis.joint, trial.own
        ):
            continue
        known = best.get(hypothesis.key)
        # A difference of rounding is none: the first of the catalogue counts.
        if known is None or support > known.support + 1e-6:
            best[hypothesis.key] = trial
    return sorted(best.values(), key=lambda trial: -round(trial.support, 6))


def _smallest(
    changes: ChangeRegression,
    refit: Explained,
    catalogue: Sequence[ParametricEffect],
    joints: int,
) -> list[_Hypothesis]:
    """Add the best cause until they are enough, and drop those that are not needed."""
    kept: list[_Hypothesis] = []
    before = changes.explain([])
    while len(kept) < MOST_CAUSES:
        trials = _trials(changes, kept, catalogue)
        if not trials or trials[0].support < LEAST_SUPPORT:
            break
        best = trials[0]
        if best.explained.statistic - before.statistic < LEAST_PART * refit.statistic:
            break
        kept.append(best.hypothesis)
        before = best.explained
        if _enough(before, refit):
            break
    for each in list(kept):
        rest = [other for other in kept if other is not each]
        explained = changes.explain([change for other in rest for change in other.changes])
        if rest and _enough(explained, refit):
            kept = rest
    return kept


def _causes(
    data: Baseline,
    changes: ChangeRegression,
    kept: Sequence[_Hypothesis],
    catalogue: Sequence[ParametricEffect],
    excess: float,
) -> tuple[ParametricCause, ...]:
    causes: list[ParametricCause] = []
    found: list[_Hypothesis] = []
    count = len({each.key for each in _hypotheses(changes, catalogue)})

    def name(joint: int | None) -> str | None:
        return None if joint is None else data.joints[joint]

    for hypothesis in kept:
        rest = [other for other in kept if other is not hypothesis]
        others = changes.explain([change for other in rest for change in other.changes])
        trials = _trials(changes, rest, catalogue)
        this = next((trial for trial in trials if trial.hypothesis.key == hypothesis.key), None)
        if this is None:
            continue
        statistic = this.explained.statistic - others.statistic
        degrees = max(this.explained.rank - others.rank, 1)
        before, after = changes.rms(this.contribution)
        rivals = []
        for trial in trials:
            if trial is this or trial.support < this.support - ALIKE:
                continue
            correlation = _correlation(changes, rest, this, trial)
            if correlation >= LEAST_CORRELATION:
                rivals.append(
                    Rival(trial.hypothesis.effect.name, name(trial.hypothesis.joint), correlation)
                )
        causes.append(
            ParametricCause(
                effect=hypothesis.effect,
                joint=name(hypothesis.joint),
                parameters=hypothesis.effect.parameters(changes.space, hypothesis.joint, this.own),
                statistic=statistic,
                p_value=min(1.0, count * float(stats.chi2.sf(statistic, degrees))),
                part=statistic / max(excess, 1.0),
                share=changes.share(this.contribution),
                before=before,
                after=after,
                rivals=tuple(rivals),
            )
        )
        found.append(hypothesis)
    order = sorted(range(len(causes)), key=lambda place: -causes[place].statistic)
    return _one_after_the_other(changes, [(causes[k], found[k]) for k in order])


def _one_after_the_other(
    changes: ChangeRegression, causes: Sequence[tuple[ParametricCause, _Hypothesis]]
) -> tuple[ParametricCause, ...]:
    """Gap before and after each cause, beside those before it."""
    sorted_causes: list[ParametricCause] = []
    together: list[Change] = []
    before, _ = changes.rms(np.zeros(changes.space.size))
    share = 0.0
    for cause, hypothesis in causes:
        together += hypothesis.changes
        contribution = changes.explain(together).contributions.sum(axis=1)
        _, after = changes.rms(contribution)
        whole = changes.share(contribution)
        sorted_causes.append(replace(cause, before=before, after=after, share=whole - share))
        before, share = after, whole
    return tuple(sorted_causes)


def _correlation(
    changes: ChangeRegression, rest: Sequence[_Hypothesis], first: _Trial, second: _Trial
) -> float:
    """Of the torques that both add, whitened, less what the other causes absorb."""
    one = changes.triangle @ first.contribution
    two = changes.triangle @ second.contribution
    directions = [change.direction for each in rest for change in each.changes]
    if directions:
        left, singular, _ = np.linalg.svd(
            changes.triangle @ np.column_stack(directions), full_matrices=False
        )
        basis = left[:, singular > 1e-9 * singular[0]]
        one, two = one - basis @ (basis.T @ one), two - basis @ (basis.T @ two)
    energy = float(np.linalg.norm(one) * np.linalg.norm(two))
    return float(abs(one @ two) / energy) if energy > 0.0 else 0.0
