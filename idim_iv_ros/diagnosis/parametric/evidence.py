"""What each parameter error explains, and from which it is indistinguishable."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.parametric.change_regression import ChangeRegression, Explained
from idim_iv_ros.diagnosis.parametric.confirmed import confirmed
from idim_iv_ros.diagnosis.parametric.hypotheses import (
    Hypothesis,
    Trial,
    changes_of,
    hypotheses,
    of_base_parameters,
    trial_of,
    trials,
)
from idim_iv_ros.diagnosis.parametric.sure import SureOnlyTogether, sure_of
from idim_iv_ros.diagnosis.result import EffectParameter, Indistinguishable
from idim_iv_ros.effects.parametric_effect import Change, Estimated, ParametricEffect
from idim_iv_ros.estimation.qr import independent_basis
from idim_iv_ros.types import FloatArray


@dataclass(frozen=True)
class ParametricCause:
    """One error of the nominal model's parameters.

    Attributes
    ----------
    effect : ParametricEffect
    joint : str or None
        None where it belongs to none.
    changes : tuple of Change
        Of the given numbers.
    parameters : dict of str to EffectParameter
        Those that the recording determines.
    statistic : float
        Wald statistic beside the other causes.
    p_value : float
        Of the statistic, corrected for the choice among all causes (Bonferroni).
    share : float
        Of the energy of the nominal model's gap that goes with it, each joint by its torque.
    before, after : (n_joints,)
        RMS of the residual with the causes before this one, and with it, N m (N).
    sizes : (n_joints,)
        RMS of the recorded torque, N m (N).
    indistinguishable_from : tuple of Indistinguishable
        Other parameter errors.
    torque : (r_j,) or None
        What it adds at its joint, N m (N); None where it belongs to none.
    """

    effect: ParametricEffect
    joint: str | None
    changes: tuple[Change, ...]
    parameters: dict[str, EffectParameter]
    statistic: float
    p_value: float
    share: float
    before: FloatArray
    after: FloatArray
    sizes: FloatArray
    indistinguishable_from: tuple[Indistinguishable, ...]
    torque: FloatArray | None

    @property
    def share_of_torque(self) -> float:
        """Largest gap that it takes at a joint, root of the energy, as a share of the torque."""
        energy = np.maximum(self.before**2 - self.after**2, 0.0)
        return float(np.max(np.sqrt(energy) / self.sizes))


def causes_of(
    joints: Sequence[str],
    changes: ChangeRegression,
    kept: Sequence[Hypothesis],
    catalogue: Sequence[ParametricEffect],
) -> tuple[ParametricCause, ...]:
    """Say what each hypothesis explains beside the others; see `judged`."""
    return judged(joints, changes, kept, catalogue)[0]


def judged(
    joints: Sequence[str],
    changes: ChangeRegression,
    kept: Sequence[Hypothesis],
    catalogue: Sequence[ParametricEffect],
) -> tuple[tuple[ParametricCause, ...], tuple[SureOnlyTogether, ...]]:
    """Say what each hypothesis explains beside the others, strongest first, and which are doubtful.

    What the configuration itself leaves out comes first; it is indistinguishable only from what no
    recording separates from it.

    Parameters
    ----------
    joints
        Names.
    kept
        The smallest set that explains the change.
    """
    count = len({each.key for each in hypotheses(changes, catalogue)})
    known = [each for each in kept if each.effect.known_to_be_left_out(changes.space)]
    few = len(kept) - len(known) <= settings.MOST_PARAMETRIC_CAUSES
    # Between recordings errors of the nominal model cancel, those of the link, too.
    sure = sure_of(changes, kept, with_own_links=few and not changes.space.difference)
    doubtful = sure.doubtful
    if kept and not sure.kept:
        # Most numbers are in error, and no few of them are significant: joint by joint, then.
        sure = sure_of(changes, [*known, *of_base_parameters(changes, catalogue, known)])
    kept, numbers = sure.kept, sure.numbers
    beside: dict[int, tuple[Trial, Explained, tuple[Estimated, ...]]] = {}
    for number, (hypothesis, own) in enumerate(zip(kept, numbers, strict=True)):
        others = changes.explain(changes_of(_without(kept, hypothesis)))
        this = trial_of(changes, _without(kept, hypothesis), hypothesis, others)
        if this is not None:
            beside[number] = (this, others, own)
    causes = []
    for number, before, after, share in _one_after_the_other(changes, kept, list(beside)):
        hypothesis, (this, others, own) = kept[number], beside[number]
        statistic = this.explained.statistic - others.statistic
        degrees = max(this.explained.rank - others.rank, 1)
        causes.append(
            ParametricCause(
                effect=hypothesis.effect,
                joint=_name(joints, hypothesis),
                changes=hypothesis.changes,
                parameters=hypothesis.effect.parameters(changes.space, hypothesis.joint, own),
                statistic=statistic,
                p_value=min(1.0, count * float(stats.chi2.sf(statistic, degrees))),
                share=share,
                before=before,
                after=after,
                sizes=changes.sizes,
                indistinguishable_from=tuple(
                    Indistinguishable(effect, joint, 1.0)
                    for effect, joint in hypothesis.effect.inseparable_from(changes.space)
                )
                if hypothesis.effect.known_to_be_left_out(changes.space)
                else _indistinguishable(
                    joints, changes, _without(kept, hypothesis), this, catalogue
                ),
                torque=_torque(changes, hypothesis, this),
            )
        )
    return tuple(causes), doubtful


def _without(kept: Sequence[Hypothesis], hypothesis: Hypothesis) -> list[Hypothesis]:
    return [other for other in kept if other is not hypothesis]


def _name(joints: Sequence[str], hypothesis: Hypothesis) -> str | None:
    return None if hypothesis.joint is None else joints[hypothesis.joint]


def _torque(changes: ChangeRegression, hypothesis: Hypothesis, this: Trial) -> FloatArray | None:
    if hypothesis.joint is None:
        return None
    return np.asarray(changes.columns[hypothesis.joint] @ this.contribution)


def _indistinguishable(
    joints: Sequence[str],
    changes: ChangeRegression,
    rest: Sequence[Hypothesis],
    this: Trial,
    catalogue: Sequence[ParametricEffect],
) -> tuple[Indistinguishable, ...]:
    """Hypotheses that would do as well in this one's place, with much the same torque.

    Of one outside the base parameters that these can imitate, what owns those of its joint.
    """
    others = _imitating(joints, changes, this, catalogue)
    for trial in trials(changes, rest, catalogue):
        same = trial.hypothesis.key == this.hypothesis.key
        same = same or any(_is(joints, trial.hypothesis, other) for other in others)
        if same or trial.support < this.support - settings.INDISTINGUISHABLE_SUPPORT:
            continue
        correlation = _correlation(changes, rest, this, trial)
        if correlation >= settings.INDISTINGUISHABLE_CORRELATION:
            name = _name(joints, trial.hypothesis)
            others.append(Indistinguishable(trial.hypothesis.effect.name, name, correlation))
    return tuple(others)


def _is(joints: Sequence[str], hypothesis: Hypothesis, other: Indistinguishable) -> bool:
    return (hypothesis.effect.name, _name(joints, hypothesis)) == (other.effect, other.joint)


def _imitating(
    joints: Sequence[str],
    changes: ChangeRegression,
    this: Trial,
    catalogue: Sequence[ParametricEffect],
) -> list[Indistinguishable]:
    """Effects that own base parameters of the joint, which imitate this one together with others.

    `correlation` is the multiple one of its torque, whitened, with all base parameters.
    """
    hypothesis = this.hypothesis
    inside = changes.space.difference or hypothesis.effect.in_base_parameters
    if inside or confirmed(changes, this.own):
        return []
    rows = changes.factor @ np.column_stack([each.direction for each in changes.base_parameters])
    torque = changes.factor @ this.contribution
    rest = independent_basis(rows, tolerance=settings.LEAST_DIRECTION).remove(torque[:, None])
    energy = max(float(torque @ torque), 1e-300)
    correlation = float(np.sqrt(max(1.0 - float(np.sum(rest**2)) / energy, 0.0)))
    return [
        Indistinguishable(each.effect.name, _name(joints, each), correlation)
        for each in of_base_parameters(changes, catalogue)
        if hypothesis.joint in (None, each.joint)
    ]


def _one_after_the_other(
    changes: ChangeRegression, kept: Sequence[Hypothesis], numbers: Sequence[int]
) -> list[tuple[int, FloatArray, FloatArray, float]]:
    """Order of the causes of these numbers, each with the gap before and after it and its share.

    Always the one that takes most, beside those before it; what the configuration leaves out comes
    first.
    """
    left = list(numbers)
    ordered = []
    together: list[Change] = []
    before, _ = changes.rms(np.zeros(changes.space.size))
    share = 0.0
    while left:
        contributions = {
            number: changes.explain([*together, *kept[number].changes]).contributions.sum(axis=1)
            for number in left
        }
        shares = {number: changes.share(contributions[number]) for number in left}
        known = {number: kept[number].effect.known_to_be_left_out(changes.space) for number in left}
        most = max(left, key=lambda number: (known[number], shares[number]))
        left.remove(most)
        together += kept[most].changes
        _, after = changes.rms(contributions[most])
        ordered.append((most, before, after, shares[most] - share))
        before, share = after, shares[most]
    return ordered


def _correlation(
    changes: ChangeRegression, rest: Sequence[Hypothesis], first: Trial, second: Trial
) -> float:
    """Of the torques that both add, whitened, less what the other causes absorb."""
    one = changes.factor @ first.contribution
    two = changes.factor @ second.contribution
    directions = [change.direction for change in changes_of(rest)]
    if directions:
        left, singular, _ = np.linalg.svd(
            changes.factor @ np.column_stack(directions), full_matrices=False
        )
        basis = left[:, singular > 1e-9 * singular[0]]
        one, two = one - basis @ (basis.T @ one), two - basis @ (basis.T @ two)
    energy = float(np.linalg.norm(one) * np.linalg.norm(two))
    return float(abs(one @ two) / energy) if energy > 0.0 else 0.0
