"""How far each motor is ahead of its link, beside the torque that its gear transmits.

The torque is the load: that of the links alone, from the refit. The measured effort would not do.
It holds friction, of which nobody knows how much lies before the gear and how much behind, and
noise, which makes every shaft look stiffer than it is. What friction behind the gear twists follows
the direction of motion and the speed, and is kept apart by that.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy

from idim_iv_ros.diagnosis.likelihood import Regression
from idim_iv_ros.diagnosis.refit.baseline import SHIFT_SPLINE, Baseline
from idim_iv_ros.estimation.observation import segments_of
from idim_iv_ros.signals import Motion
from idim_iv_ros.signals.motion import all_around
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

LINK_MOTION_STEPS = 3  # times that the load is computed again at the link's motion
_STEP_TOLERANCE = 0.01  # steps: up to here an encoder's values lie on a grid
_ON_ONE_SIDE = 0.98  # decimated sign of the load from which a link in play lies on one side
_SIDE_MARGIN = 2  # rows beside a change of side: the link flies there
# Base parameters that are none of the links.
_NOT_OF_LINKS = ("Fv", "Fc", "off", "Ia")
# Fields of `TwistRows` with a value for each row.
_ROWS = (
    *("load", "load_rate", "load_columns", "side"),
    *("speed", "direction", "position", "recording"),
)


@dataclass(frozen=True)
class TwistRows:
    """Rows of one joint over all recordings; (r,) each.

    Attributes
    ----------
    channels : tuple of (Motion, (m,) bool)
        Recordings with positions before and behind the gear, and their decimated samples that
        count.
    load, load_rate : N m, N m/s
        Torque of the links, from the refit.
    side, direction : −1 to 1
        Sign of the load and of the speed; between while the joint sticks.
    recording : int
        Which recording each row belongs to.
    segments : tuple of slice
        Rows that are contiguous in time.
    load_columns, load_covariance : (r, b), (b, b)
        Change of the load with each base parameter of the links, and their covariance.
    resolution : float
        Step of the coarser encoder, rad; zero where none shows.
    chosen : (n,) bool or None
        Which rows of the channels these are; None: all.
    """

    joint: int
    channels: tuple[tuple[Motion, BoolArray], ...]
    load: FloatArray
    load_rate: FloatArray
    side: FloatArray
    speed: FloatArray
    direction: FloatArray
    position: FloatArray
    recording: IntArray
    segments: tuple[slice, ...]
    load_columns: FloatArray
    load_covariance: FloatArray
    resolution: float
    chosen: BoolArray | None = None

    @property
    def constants(self) -> FloatArray:
        """(r, recordings) one column for each recording."""
        return np.asarray(self.recording[:, None] == np.unique(self.recording), dtype=float)

    def twist(self, offset: float) -> FloatArray:
        """Motor less link (r,) rad, with the link's channel read `offset` seconds later."""
        parts = []
        for motion, counting in self.channels:
            signals = motion.signals
            assert signals.link_position is not None
            link, later = signals.link_position[:, self.joint], -offset * signals.rate
            link = scipy.ndimage.shift(link, later, order=SHIFT_SPLINE, mode="nearest")
            twist = (signals.position[:, self.joint] - link)[motion.span]
            parts.append(motion.decimation.whole(twist)[counting])
        twist = np.concatenate(parts)
        return twist if self.chosen is None else twist[self.chosen]

    def away_from_side_changes(self) -> "TwistRows":
        """Return the rows at which a link in play has come to rest on one side.

        In play it flies from one side to the other, which a step of the load's sign does not say.
        """
        near = np.abs(self.side) < _ON_ONE_SIDE
        chosen = np.ones(len(near), dtype=bool)
        for segment in self.segments:
            spread = np.convolve(near[segment], np.ones(2 * _SIDE_MARGIN + 1), mode="same")
            chosen[segment] = spread[: segment.stop - segment.start] < 0.5
        rows: dict[str, Any] = {name: getattr(self, name)[chosen] for name in _ROWS}
        segments = segments_of([chosen[segment] for segment in self.segments])
        return replace(self, **rows, segments=segments, chosen=chosen)


def has_encoder(data: Baseline, joint: int) -> bool:
    """Whether every recording holds positions of the joint behind its gear."""
    return all(
        motion.signals.link_valid is not None and bool(motion.signals.link_valid[:, joint].any())
        for motion in data.prepared.motions
    )


def twist_rows(
    data: Baseline,
    regression: Regression,
    joint: int,
    compliance: float = 0.0,
    values: FloatArray | None = None,
) -> TwistRows:
    """Rows of one joint, where both encoders were read.

    Parameters
    ----------
    compliance
        Of the shaft, rad/(N m), as far as it is known: the link needs the torque of its own motion,
        which is the motor's less the twist.
    values
        (b,) base parameters of the links, where those of the refit are not: it takes the motor's
        motion for theirs.
    """
    channels, parts, taken = [], [], []
    pairs = zip(data.prepared.motions, data.motions, strict=True)
    for number, (motion, smooth) in enumerate(pairs):
        assert motion.signals.link_valid is not None
        valid = motion.signals.link_valid[motion.span, joint : joint + 1]
        measured = all_around(valid, motion.decimation, motion.decimation.factor)[:, 0]
        kept = motion.kept[:, joint]
        counting = kept & measured
        channels.append((motion, counting))
        taken.append(measured[kept])
        load = smooth.load[:, joint]
        for _ in range(LINK_MOTION_STEPS if compliance > 0.0 else 0):
            behind = smooth.moved(joint, -compliance * load, links=True)
            load = smooth.load[:, joint] + behind[:, joint]
        series = (
            load,
            np.gradient(load, 1.0 / smooth.rate),
            np.sign(load),
            smooth.velocity[:, joint],
            smooth.slip[:, joint],
            smooth.position[:, joint],
        )
        rows = [smooth.rows(values)[counting] for values in series]
        parts.append([*rows, np.full(int(counting.sum()), number)])
    load, rate, side, speed, direction, position, recording = map(
        np.concatenate, zip(*parts, strict=True)
    )
    columns, places, covariance = _of_links(data, regression, joint)
    columns = columns[np.concatenate(taken)]
    fitted = regression.fit().values if values is None else values
    # The motion holds the parameters of another estimator.
    load = load + columns @ (fitted - data.estimate.linear.values)[places]
    return TwistRows(
        joint=joint,
        channels=tuple(channels),
        load=load,
        load_rate=rate,
        side=side,
        speed=speed,
        direction=direction,
        position=position,
        recording=recording.astype(np.int64),
        segments=segments_of([counting for _, counting in channels]),
        load_columns=columns,
        load_covariance=covariance,
        resolution=_resolution(data, joint),
    )


def _of_links(
    data: Baseline, regression: Regression, joint: int
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Columns of the links' base parameters at one joint, which, and their covariance."""
    rows, names = regression.joints[joint], data.prepared.model.base.names
    of_links = [
        place
        for place, column in enumerate(rows.columns)
        if not names[column].startswith(_NOT_OF_LINKS)
    ]
    parameters = rows.columns[of_links]
    covariance = regression.fit().covariance[np.ix_(parameters, parameters)]
    return rows.matrix[:, of_links], parameters, covariance


def _resolution(data: Baseline, joint: int) -> float:
    """Step of the coarser of the two encoders, rad; zero where values lie on no grid."""
    steps = [0.0]
    for motion in data.prepared.motions:
        signals = motion.signals
        assert signals.link_position is not None
        for values in (signals.position[:, joint], signals.link_position[:, joint]):
            apart = np.diff(np.unique(np.round(values, 12)))
            if len(apart) == 0:
                continue
            ratios = apart / apart.min()
            if float(np.abs(ratios - np.round(ratios)).max()) < _STEP_TOLERANCE:
                steps.append(float(apart.min()))
    return max(steps)
