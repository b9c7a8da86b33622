"""Two sets of recordings as one regression, each on the motion and the loads of its own refit.

Everything that differs between the sets enters their rows: a payload of the second set changes the
load that a load-dependent friction of both sees, and its closed loop moves otherwise. So each set
has a refit, simulated motion and alignment of the effort of its own, in one processing; only then
are their rows put under one another.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis.likelihood import rms
from idim_iv_ros.diagnosis.refit.baseline import Baseline, proposals, refit_of
from idim_iv_ros.diagnosis.refit.refit import Refit, on_likelier_motion
from idim_iv_ros.identification.prepare import prepare
from idim_iv_ros.identification.sanity import ANOTHER_UNIT, in_smaller_units
from idim_iv_ros.recording.recording import Recording, Session, session_of
from idim_iv_ros.types import BoolArray, FloatArray

_FOLLOWS = 0.5  # of the energy of an effort


@dataclass(frozen=True)
class TwoSets:
    """Rows of both sets, those of the reference first.

    `data`: of all recordings: motions, rows and their recordings. Its estimate is the reference's.
    `refits`: of reference and second set by themselves. `not_compared`: joints whose efforts are
    not torques of one robot in both sets, and why; their rows are left out.
    """

    data: Baseline
    refits: tuple[Refit, Refit]
    not_compared: dict[int, str]

    @property
    def first(self) -> frozenset[int]:
        """Numbers of the reference's recordings in `data`."""
        return frozenset(range(len(self.refits[0].data.motions)))

    @property
    def second(self) -> frozenset[int]:
        """Numbers of the second set's recordings in `data`."""
        return frozenset(range(len(self.data.motions))) - self.first

    def bags(self, numbers: frozenset[int]) -> tuple[str, ...]:
        """Names of some recordings."""
        parts = self.data.prepared.session.parts
        return tuple(parts[number].bag for number in sorted(numbers))

    @cached_property
    def inside(self) -> tuple[BoolArray, ...]:
        """Rows (r_j,) of the second set, for each joint."""
        return tuple(np.isin(recording, list(self.second)) for recording in self.data.recordings)

    @cached_property
    def sizes(self) -> FloatArray:
        """RMS (n_joints,) of the torque in the second set, N m (N)."""
        rows = zip(self.data.rows, self.inside, strict=True)
        return np.maximum([rms(joint.torque[inside]) for joint, inside in rows], 1e-300)


def two_sets(
    reference: Sequence[Recording], against: Sequence[Recording], configuration: Configuration
) -> TwoSets:
    """Refit each set by itself and put their rows under one another; errors as `identify`.

    The noisier set limits the band, and all rows come at one rate.
    """
    for section in proposals((reference, against), configuration):
        whole, sets = prepare([*reference, *against], section), []
        numbers = {id(recording): number for number, recording in enumerate(whole.recordings)}
        for part in (reference, against):  # filtered as all recordings are; its time starts at zero
            session = session_of(part)
            places = [numbers[id(recording)] for recording in session.recordings]
            factors = tuple(whole.cutoffs.factors[place] for place in places)
            motions = tuple(whole.motions[place] for place in places)
            cutoffs = replace(whole.cutoffs, factors=factors)
            prepared = replace(whole, session=session, cutoffs=cutoffs, motions=motions)
            sets.append(refit_of(prepared))
        if all(data.sticking for data in sets):
            break
    refits = on_likelier_motion(sets[0]), on_likelier_motion(sets[1])
    first, second = (refit.data for refit in refits)
    why = _not_compared(first, second)
    one, other = first.prepared, second.prepared
    parts = (*one.session.parts, *other.session.parts)
    prepared = replace(
        one,
        session=Session((*one.recordings, *other.recordings), parts, ()),
        cutoffs=replace(one.cutoffs, factors=(*one.cutoffs.factors, *other.cutoffs.factors)),
        motions=(*one.motions, *other.motions),
    )
    joints = tuple(
        replace(rows.joined([more]), left_out=joint in why)
        for joint, (rows, more) in enumerate(zip(first.rows, second.rows, strict=True))
    )
    data = replace(
        first,
        prepared=prepared,
        regression=replace(first.regression, joints=joints),
        sticking=first.sticking and second.sticking,
    )
    return TwoSets(data.on((*first.motions, *second.motions)), refits, why)


def _not_compared(reference: Baseline, second: Baseline) -> dict[int, str]:
    """Joints whose efforts are not torques of one robot in both sets, and why.

    A set is judged by itself first. Then its effort may follow what the numbers of the reference
    need on its motion, but in a smaller unit, at most joints or where in_smaller_units says so: no
    robot changes so.
    """
    why: dict[int, str] = {}
    for data, name in ((reference, "the reference"), (second, "the second set")):
        for finding in data.prepared.joint_findings:
            if finding.left_out:
                why.setdefault(finding.joint, f"in {name} {finding.sentence}")
    ratios: dict[int, float] = {}
    for joint, rows in enumerate(second.rows):
        needed = rows.prediction(reference.estimate.linear.values)
        common, energy = float(needed @ rows.torque), float(needed @ needed)
        if joint not in why and common**2 > _FOLLOWS * energy * float(rows.torque @ rows.torque):
            ratios[joint] = common / energy
    of_all = float(np.median(list(ratios.values()))) if ratios else 1.0
    sizes = dict(enumerate(second.torque_sizes.tolist()))
    for joint in ratios if of_all > ANOTHER_UNIT else in_smaller_units(ratios, sizes):
        why[joint] = (
            f"in the second set the effort is {ratios[joint]:.2g} times what the reference needs "
            "for such a motion, and follows it: another unit?"
        )
    return why
