"""Two sets of recordings as one regression, each on the motion and the loads of its own refit.

Everything that differs between the sets enters their rows: a payload of the second set changes the
load that a load-dependent friction of both sees, and its closed loop moves otherwise. So each set
has a refit, simulated motion and alignment of the effort of its own, in one processing; only then
are their rows put under one another.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis.likelihood import Regression
from idim_iv_ros.diagnosis.refit.baseline import (
    Baseline,
    refit_of,
    smooth_regression,
    with_offsets,
)
from idim_iv_ros.diagnosis.refit.processing import proposals
from idim_iv_ros.diagnosis.refit.refit import on_likelier_motion
from idim_iv_ros.diagnosis.refit.signal_chain import EffortShift
from idim_iv_ros.diagnosis.refit.soft_friction import SoftFriction
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.identification.prepare import PreparedRegression, prepare
from idim_iv_ros.recording import Recording, Session, session_of
from idim_iv_ros.types import BoolArray


@dataclass(frozen=True)
class TwoSets:
    """Rows of both sets, those of the reference first.

    Attributes
    ----------
    data : Baseline
        Of all recordings: motions, rows and their recordings. Its estimate is the reference's.
    regression : Regression
        On the smooth motion.
    sets : (Baseline, Baseline)
        Reference and second set by themselves.
    shifts : (EffortShift, EffortShift)
        Taken out of the effort of each set.
    softened : (SoftFriction or None, SoftFriction or None)
        Of a simulator's solver, in the motions of each set.
    """

    data: Baseline
    regression: Regression
    sets: tuple[Baseline, Baseline]
    shifts: tuple[EffortShift, EffortShift]
    softened: tuple[SoftFriction | None, SoftFriction | None]

    @property
    def second(self) -> frozenset[int]:
        """Numbers of the second set's recordings in `data`."""
        first = len(self.sets[0].motions)
        return frozenset(range(first, len(self.data.motions)))

    @property
    def regression_of_reference(self) -> Regression:
        """Rows of the reference by itself."""
        return smooth_regression(self.sets[0])

    @property
    def inside(self) -> tuple[BoolArray, ...]:
        """Rows (r_j,) of the second set, for each joint."""
        return tuple(np.isin(recording, list(self.second)) for recording in self.data.recordings)


def two_sets(
    reference: Sequence[Recording], against: Sequence[Recording], configuration: Configuration
) -> TwoSets:
    """Refit each set by itself and put their rows under one another.

    The noisier set limits the band, and all rows come at one rate.

    Raises
    ------
    UsageError, DataError
        As `identify`, for each set: each must excite every parameter.
    """
    parts = reference, against
    for section in proposals(parts, with_offsets(configuration)):
        whole = prepare([*reference, *against], section)
        sets = [refit_of(_part(whole, part)) for part in parts]
        if all(each.sticking for each in sets):
            break
    one, other = (
        on_likelier_motion(recordings, smooth_regression(recordings)) for recordings in sets
    )
    data = _together(one.data, other.data)
    return TwoSets(
        data,
        smooth_regression(data),
        (one.data, other.data),
        (one.shift, other.shift),
        (one.softened, other.softened),
    )


def _part(whole: PreparedRegression, recordings: Sequence[Recording]) -> PreparedRegression:
    """Keep some recordings of a session, filtered as all of them are; their time starts at zero."""
    session = session_of(recordings)
    places = [
        next(k for k, each in enumerate(whole.recordings) if each is recording)
        for recording in session.recordings
    ]
    factors = tuple(whole.cutoffs.factors[place] for place in places)
    return replace(
        whole,
        session=session,
        cutoffs=replace(whole.cutoffs, factors=factors),
        motions=tuple(whole.motions[place] for place in places),
    )


def _together(first: Baseline, second: Baseline) -> Baseline:
    one, other = first.prepared, second.prepared
    session = Session(
        (*one.recordings, *other.recordings),
        (*one.session.parts, *other.session.parts),
        (),
    )
    prepared = replace(
        one,
        session=session,
        cutoffs=replace(one.cutoffs, factors=(*one.cutoffs.factors, *other.cutoffs.factors)),
        motions=(*one.motions, *other.motions),
    )
    return replace(
        first,
        prepared=prepared,
        rows=tuple(_rows(a, b) for a, b in zip(first.rows, second.rows, strict=True)),
        motions=(*first.motions, *second.motions),
        sticking=first.sticking and second.sticking,
    )


def _rows(first: JointRows, second: JointRows) -> JointRows:
    start = len(first)
    later = tuple(slice(start + segment.start, start + segment.stop) for segment in second.segments)
    return JointRows(
        np.concatenate([first.matrix, second.matrix]),
        np.concatenate([first.torque, second.torque]),
        first.columns,
        (*first.segments, *later),
        first.name,
        left_out=first.left_out or second.left_out,
    )
