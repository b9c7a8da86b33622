"""How far each motor is ahead of its link, beside the torque that its gear transmits.

The torque is the load: that of the links alone, from the refit, at the motor's motion. The measured
effort would not do. It holds friction, of which nobody knows how much lies before the gear and
how much behind, and noise, which makes every shaft look stiffer than it is. What friction behind
the gear twists follows the direction of motion and the speed, and is kept apart by that.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.structural.likelihood import Regression
from idim_iv_ros.signals import Motion
from idim_iv_ros.signals.motion import all_around
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

# Base parameters that are none of the links.
_NOT_OF_LINKS = ("Fv", "Fc", "off", "Ia")


@dataclass(frozen=True)
class LinkChannel:
    """One joint's positions before and behind its gear in one recording, and its rows.

    Attributes
    ----------
    motion : Motion
    joint : int
    counting : (m,) bool
        Decimated samples that count.
    """

    motion: Motion
    joint: int
    counting: BoolArray

    def twist(self, offset: float) -> FloatArray:
        """Motor less link (r,) rad, with the link's channel read `offset` seconds later."""
        signals, span = self.motion.signals, self.motion.span
        assert signals.link_position is not None
        link = signals.link_position[:, self.joint]
        later = scipy.ndimage.shift(
            link, -offset * signals.rate, order=settings.SHIFT_SPLINE, mode="nearest"
        )
        twist = (signals.position[:, self.joint] - later)[span]
        return np.asarray(self.motion.decimation.whole(twist)[self.counting])


@dataclass(frozen=True)
class TwistRows:
    """Rows of one joint over all recordings; (r,) each.

    Attributes
    ----------
    channels : tuple of LinkChannel
    load : N m
        Torque of the links, from the refit.
    load_rate : N m/s
    side : −1 to 1
        Sign of the load.
    speed : rad/s
    direction : −1 to 1
        Sign of the speed, and between while the joint sticks.
    position : rad
    recording : int
        Which recording each row belongs to.
    segments : tuple of slice
        Rows that are contiguous in time.
    load_columns : (r, b)
        Change of the load with each base parameter of the links.
    load_covariance : (b, b)
        Of these parameters.
    resolution : float
        Step of the coarser encoder, rad; zero where none shows.
    """

    channels: tuple[LinkChannel, ...]
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

    def twist(self, offset: float) -> FloatArray:
        """Motor less link (r,) rad, with the link's channel read `offset` seconds later."""
        return np.concatenate([channel.twist(offset) for channel in self.channels])


def has_encoder(data: Baseline, joint: int) -> bool:
    """Whether every recording holds positions of the joint behind its gear."""
    return all(
        motion.signals.link_valid is not None and bool(motion.signals.link_valid[:, joint].any())
        for motion in data.prepared.motions
    )


def twist_rows(data: Baseline, regression: Regression, joint: int) -> TwistRows:
    """Rows of one joint, where both encoders were read.

    Parameters
    ----------
    regression
        Of the refit on the smooth motion.
    """
    channels, parts, taken = [], [], []
    for number, (motion, smooth) in enumerate(
        zip(data.prepared.motions, data.motions, strict=True)
    ):
        assert motion.signals.link_valid is not None
        valid = motion.signals.link_valid[motion.span, joint : joint + 1]
        measured = all_around(valid, motion.decimation, motion.decimation.factor)[:, 0]
        kept = motion.kept[:, joint]
        counting = kept & measured
        channels.append(LinkChannel(motion, joint, counting))
        taken.append(measured[kept])
        load = smooth.load[:, joint]
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
    load, rate, side, speed, direction, position, recording = (
        np.concatenate(column) for column in zip(*parts, strict=True)
    )
    columns, covariance = _of_links(data, regression, joint)
    inside = np.concatenate(taken)
    return TwistRows(
        channels=tuple(channels),
        load=load,
        load_rate=rate,
        side=side,
        speed=speed,
        direction=direction,
        position=position,
        recording=recording.astype(np.int64),
        segments=_segments(data, channels),
        load_columns=columns[inside],
        load_covariance=covariance,
        resolution=_resolution(data, joint),
    )


def _of_links(data: Baseline, regression: Regression, joint: int) -> tuple[FloatArray, FloatArray]:
    """Columns of the links' base parameters at one joint, and their covariance in the refit."""
    rows, names = regression.joints[joint], data.prepared.model.base.names
    own = [
        place
        for place, column in enumerate(rows.columns)
        if not names[column].startswith(_NOT_OF_LINKS)
    ]
    parameters = rows.columns[own]
    covariance = regression.fit().covariance[np.ix_(parameters, parameters)]
    return rows.matrix[:, own], covariance


def _segments(data: Baseline, channels: Sequence[LinkChannel]) -> tuple[slice, ...]:
    """Runs of neighbouring decimated samples, recording by recording."""
    segments, first = [], 0
    for channel in channels:
        places = np.flatnonzero(channel.counting)
        cuts = np.flatnonzero(np.diff(places) != 1) + 1
        for run in np.split(places, cuts):
            if len(run):
                segments.append(slice(first, first + len(run)))
                first += len(run)
    return tuple(segments)


def _resolution(data: Baseline, joint: int) -> float:
    """Step of the coarser of the two encoders, rad; zero where values hardly ever repeat."""
    steps = [0.0]
    for motion in data.prepared.motions:
        signals = motion.signals
        assert signals.link_position is not None
        for values in (signals.position[:, joint], signals.link_position[:, joint]):
            distinct = np.unique(np.round(values, 12))
            if len(distinct) < settings.REPEATING_ENCODER * len(values) and len(distinct) > 1:
                steps.append(float(np.diff(distinct).min()))
    return max(steps)
