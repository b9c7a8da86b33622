"""Whether one set of numbers holds for all recordings, and which recording differs in what.

A payload mounted for some recordings and not for others makes one mean payload with a small
interval: a wrong number that looks sure. So numbers may differ in every recording, beside the
effects that all of them have.
"""

from collections.abc import Collection, Sequence

import numpy as np

from idim_iv_ros.diagnosis.against.changes import changes_between, number_changes, rms_of
from idim_iv_ros.diagnosis.comparison.beside import Term
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import Difference, RecordingAgreement
from idim_iv_ros.diagnosis.structural.likelihood import Regression
from idim_iv_ros.effects.registry import STRUCTURAL
from idim_iv_ros.types import FloatArray


def agreement(
    data: Baseline,
    regression: Regression,
    beside: Sequence[Term] = (),
    without: Collection[str] = (),
) -> tuple[RecordingAgreement, ...]:
    """Let numbers differ in every recording; one entry for each of several, empty of one.

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
    differences: dict[int, list[tuple[FloatArray, Difference]]] = {}
    for each in number_changes(changes):
        shares = rms_of(data, each.terms, each.recordings) / np.array(data.torque_sizes)
        joint = None if each.joint is None else data.joints[each.joint]
        difference = Difference(each.effect.name, joint, each.parameters(changes))
        for number in each.recordings:
            differences.setdefault(number, []).append((shares, difference))
    return tuple(
        _entry(data, part.bag, differences.get(number, ()))
        for number, part in enumerate(data.prepared.session.parts)
    )


def _entry(
    data: Baseline, bag: str, differences: Sequence[tuple[FloatArray, Difference]]
) -> RecordingAgreement:
    """One recording with its differences and their shares of the torque (n_joints,)."""
    ordered = sorted(differences, key=lambda each: -float(each[0].max()))
    squares = sum((shares**2 for shares, _ in ordered), np.zeros(len(data.joints)))
    joint = int(np.argmax(squares))
    return RecordingAgreement(
        bag=bag,
        agrees=not ordered,
        joint=data.joints[joint],
        share_of_torque=float(np.sqrt(squares[joint])),
        differences=tuple(difference for _, difference in ordered),
    )
