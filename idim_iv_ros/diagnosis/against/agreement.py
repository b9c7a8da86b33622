"""Whether one set of numbers holds for all recordings, and which recording differs in what.

A payload mounted for some recordings and not for others makes one mean payload with a small
interval: a wrong number that looks sure. So numbers may differ in every recording, beside the
effects that all of them have.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.diagnosis.against.changes import changes_between, number_changes, rms_of
from idim_iv_ros.diagnosis.comparison.beside import Term
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import EffectParameter
from idim_iv_ros.diagnosis.structural.likelihood import Regression
from idim_iv_ros.effects.registry import STRUCTURAL
from idim_iv_ros.types import FloatArray


@dataclass(frozen=True)
class ChangeOfNumbers:
    """One thing in which a recording differs: effect, joint or None, and its numbers."""

    effect: str
    joint: int | None
    parameters: dict[str, EffectParameter]


@dataclass(frozen=True)
class RecordingDifference:
    """One recording that the numbers of the others do not fit.

    Attributes
    ----------
    recording : int
        From 0, in the order of the session.
    shares : (n_joints,)
        Torque that the difference makes in it, as a share of the joint's torque.
    causes : tuple of ChangeOfNumbers
        The largest first.
    """

    recording: int
    shares: FloatArray
    causes: tuple[ChangeOfNumbers, ...]


def agreement(
    data: Baseline,
    regression: Regression,
    beside: Sequence[Term] = (),
    without: Collection[str] = (),
) -> tuple[RecordingDifference, ...]:
    """Let numbers differ in every recording; empty where none does.

    Of two recordings that differ the second is named: nothing says which of them is right.

    Parameters
    ----------
    regression
        Of the refit.
    beside
        Structural causes, whose torque is taken out first.
    without
        Effects that are left out of the catalogue.
    """
    count = len(data.motions)
    if count < 2:
        return ()
    first = 1 if count == 2 else 0
    scopes = [frozenset({number}) for number in range(first, count)]
    structural = {effect.name for effect in STRUCTURAL}
    changes = changes_between(data, regression, (), scopes, {*without, *structural}, beside)
    found: dict[int, list[tuple[float, FloatArray, ChangeOfNumbers]]] = {}
    for each in number_changes(changes):
        shares = rms_of(data, each.terms, each.recordings) / np.array(data.torque_sizes)
        change = ChangeOfNumbers(each.effect.name, each.joint, each.parameters(changes))
        for number in each.recordings:
            found.setdefault(number, []).append((float(shares.max()), shares, change))
    made = []
    for number, causes in sorted(found.items()):
        causes.sort(key=lambda cause: -cause[0])
        whole = np.sqrt(sum(shares**2 for _, shares, _ in causes))
        made.append(RecordingDifference(number, whole, tuple(change for *_, change in causes)))
    return tuple(made)
