"""Causes that may lie behind a change of the given numbers, each tried beside those kept."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.parametric.change_regression import ChangeRegression, Explained
from idim_iv_ros.diagnosis.parametric.confirmed import confirmed, takes_nearly_all
from idim_iv_ros.diagnosis.parametric.other_errors import estimated_beside_other_errors
from idim_iv_ros.diagnosis.parametric.significance import differs
from idim_iv_ros.effects.parametric_effect import Change, Estimated, ParametricEffect
from idim_iv_ros.types import FloatArray


@dataclass(frozen=True)
class Hypothesis:
    """One effect at one place, with one set of numbers that it may change.

    Attributes
    ----------
    effect : ParametricEffect
    joint : int or None
        None where it belongs to none.
    changes : tuple of Change
    """

    effect: ParametricEffect
    joint: int | None
    changes: tuple[Change, ...]

    @property
    def key(self) -> tuple[str, int | None]:
        """Effect and place, whatever the variant."""
        return self.effect.name, self.joint


@dataclass(frozen=True)
class Trial:
    """One hypothesis beside those that are kept.

    Attributes
    ----------
    hypothesis : Hypothesis
    explained : Explained
        By those that are kept and, last, by this one.
    support : float
        Logarithm of the likelihood that it brings, less ½ ln(rows) for each number (Schwarz).
    """

    hypothesis: Hypothesis
    explained: Explained
    support: float

    @property
    def own(self) -> tuple[Estimated, ...]:
        """Estimates of its changes."""
        return self.explained.found[-len(self.hypothesis.changes) :]

    @property
    def tells(self) -> bool:
        """Whether at least one of its numbers is known to differ from zero."""
        return any(differs(each.value, each.std) for each in self.own)

    @property
    def contribution(self) -> FloatArray:
        """What its changes add together, (d,) in the coordinates of the space."""
        own = self.explained.contributions[:, -len(self.hypothesis.changes) :]
        return np.asarray(own.sum(axis=1))


def changes_of(hypotheses: Sequence[Hypothesis]) -> list[Change]:
    """All changes, in the order of the hypotheses."""
    return [change for each in hypotheses for change in each.changes]


def hypotheses(
    changes: ChangeRegression, catalogue: Sequence[ParametricEffect]
) -> list[Hypothesis]:
    """Every variant of every effect at every place whose joint, or any joint, moves enough."""
    space = changes.space
    if len(changes.still) == space.joints:
        return []
    return [
        Hypothesis(effect, joint, tuple(variant))
        for effect in catalogue
        for joint in effect.places(space)
        if joint not in changes.still
        for variant in effect.variants(space, joint)
    ]


def of_base_parameters(
    changes: ChangeRegression,
    catalogue: Sequence[ParametricEffect],
    known: Sequence[Hypothesis] = (),
) -> list[Hypothesis]:
    """Every effect that owns base parameters, at every joint: together they are the refit.

    Parameters
    ----------
    known
        Causes that are in the model in any case; their effects are left out.
    """
    space = changes.space
    named = {each.effect.name for each in known}
    owned = [
        Hypothesis(effect, joint, tuple(effect.base_parameters(space, joint)))
        for effect in catalogue
        if effect.name not in named
        for joint in range(space.joints)
        if joint not in changes.still
    ]
    return [each for each in owned if each.changes]


def trial_of(
    changes: ChangeRegression,
    kept: Sequence[Hypothesis],
    hypothesis: Hypothesis,
    base: Explained,
) -> Trial | None:
    """One cause beside those that are kept; None where they leave nothing for it to say.

    A cause of which no number is known to differ from zero is none, however much its numbers
    explain together; nor is one that physics does not allow. `base`: what those kept explain.
    """
    explained = changes.explain([*changes_of(kept), *hypothesis.changes])
    gain = 0.5 * (explained.statistic - base.statistic)
    numbers = explained.rank - base.rank
    trial = Trial(hypothesis, explained, gain - 0.5 * numbers * float(np.log(changes.rows)))
    if numbers <= 0 or not trial.tells or not _allowed(changes, kept, trial):
        return None
    return trial


def _allowed(changes: ChangeRegression, kept: Sequence[Hypothesis], trial: Trial) -> bool:
    """Whether physics allows the numbers; of what takes nearly all, beside errors of all others.

    Inertials that are off by ten percent make a hand that is not mounted look as if it took more
    inertia with it than there is, by many deviations of the noise. They look like a wrong gain of
    the torque, too: one is allowed where base parameters cannot imitate it, or where it alone
    makes most of them unnecessary. Numbers that may all be zero beside the errors of all others
    are no cause, whether physics allows them or not.
    """
    space, hypothesis = changes.space, trial.hypothesis
    if not (space.difference or hypothesis.effect.in_base_parameters) and not (
        confirmed(changes, trial.own) or takes_nearly_all(changes, hypothesis.changes)
    ):
        return False
    if space.difference or hypothesis.effect.admissible(space, hypothesis.joint, trial.own):
        return True
    if changes.share(trial.explained.contributions.sum(axis=1)) < settings.ENOUGH_OF_CHANGE:
        return False
    named = [*changes_of(kept), *hypothesis.changes]
    beside = estimated_beside_other_errors(changes, named)
    part = slice(len(named) - len(hypothesis.changes), len(named))
    if beside.p_value(part) > settings.PARAMETRIC_LEVEL:
        return False
    return hypothesis.effect.admissible(space, hypothesis.joint, beside.found[part])


def trials(
    changes: ChangeRegression,
    kept: Sequence[Hypothesis],
    catalogue: Sequence[ParametricEffect],
) -> list[Trial]:
    """Each cause beside those that are kept, in its best variant; the best first."""
    taken = {each.key for each in kept}
    base = changes.explain(changes_of(kept))
    best: dict[tuple[str, int | None], Trial] = {}
    for hypothesis in hypotheses(changes, catalogue):
        if hypothesis.key in taken:
            continue
        trial = trial_of(changes, kept, hypothesis, base)
        if trial is None:
            continue
        known = best.get(hypothesis.key)
        # A difference of rounding is none: the first of the catalogue counts.
        if known is None or trial.support > known.support + 1e-6:
            best[hypothesis.key] = trial
    return sorted(best.values(), key=lambda trial: -round(trial.support, 6))
