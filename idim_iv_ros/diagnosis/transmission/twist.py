"""How far each motor is ahead of its link, beside the torque that its gear transmits.

The torque is the load: that of the links alone, from the refit. The measured effort would not do.
It holds friction, of which nobody knows how much lies before the gear and how much behind, and
noise, which makes every shaft look stiffer than it is. What friction behind the gear twists follows
the direction of motion and the speed, and is kept apart by that.

twist = load / K + (gap / 2) sign(load) + h sign(speed) + s · speed − (D / K²) d(load)/dt + g(q) + c

K is the stiffness, D the damping, s the time by which the link's channel is late: that is no
elasticity, and always in the model. h is play that friction keeps on one side, or friction
behind the gear. g is an error of an encoder that depends on the position. What is not always
there is chosen by the comparison that chooses causes. Rows are whitened by an autoregressive model
of the residual.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.comparison.folds import chosen_without
from idim_iv_ros.diagnosis.comparison.model_with_terms import Term
from idim_iv_ros.diagnosis.comparison.named_columns import (
    FREE,
    NamedColumns,
    ledger_of_rows,
    supported,
)
from idim_iv_ros.diagnosis.comparison.select import Selection, select
from idim_iv_ros.diagnosis.likelihood import Fit, Regression, rms
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result.causes import Evidence
from idim_iv_ros.estimation.observation import segments_of
from idim_iv_ros.estimation.qr import independent_basis
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.signals import Motion, shifted
from idim_iv_ros.signals.motion import all_around
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

LINK_MOTION_STEPS = 3  # times that the load is computed again at the link's motion
_STEP_TOLERANCE = 0.01  # steps: up to here an encoder's values lie on a grid
_ON_ONE_SIDE = 0.98  # decimated sign of the load from which a link in play lies on one side
_SIDE_MARGIN = 2  # rows beside a change of side: the link flies there
# Base parameters that are none of the links.
_NOT_OF_LINKS = ("Fv", "Fc", "off", "Ia")
_OFFSET_STEPS = 3  # fits of the time offset, which enters to first order only
_POSITION_TERMS = 4  # cosines of an encoder's error: slower than that of a gear
_LEAST_SIDE = 0.05  # of the rows on either side of zero load, to look for play

LOAD, SIDE, DIRECTION, POSITION, RATE = "load", "side", "direction", "position", "load rate"


@dataclass(frozen=True)
class TwistRows:
    """Rows of one joint over all recordings; (r,) each.

    `channels`: recordings with positions before and behind the gear, and their decimated samples
    (m,) that count; `chosen`: which of these the rows are; None: all. `load`, `load_rate`: torque
    of the links, N m, from the refit; `side`, `direction`: sign of the load and of the speed,
    between −1 and 1 while the joint sticks. `load_columns` (r, b), `load_covariance` (b, b): change
    of the load with each base parameter of the links, and their covariance; `resolution`: step of
    the coarser encoder, rad; zero where none shows.
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
            link = shifted(signals.link_position[:, self.joint], -offset, signals.rate)
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
        rows: dict[str, Any] = {
            name: values[chosen]
            for name, values in vars(self).items()
            if isinstance(values, np.ndarray) and name != "load_covariance"
        }
        segments = segments_of([chosen[segment] for segment in self.segments])
        return replace(self, **{**rows, "segments": segments, "chosen": chosen})


def twist_rows(
    data: Baseline,
    joint: int,
    compliance: float = 0.0,
    values: FloatArray | None = None,
) -> TwistRows:
    """Rows of one joint, where both encoders were read.

    `compliance`: of the shaft, rad/(N m), as far as it is known: the link needs the torque of its
    own motion, which is the motor's less the twist; `values`: (b,) base parameters of the links,
    where those of the refit are not: it takes the motor's motion for theirs.
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
        channels.append((motion, counting))
        taken.append(measured[kept])
        load = smooth.load[:, joint]
        for _ in range(LINK_MOTION_STEPS if compliance > 0.0 else 0):
            behind = smooth.moved(joint, -compliance * load, links=True)
            load = smooth.load[:, joint] + behind[:, joint]
        series = {
            "load": load,
            "load_rate": np.gradient(load, 1.0 / smooth.rate),
            "side": np.sign(load),
            "speed": smooth.velocity[:, joint],
            "direction": smooth.slip[:, joint],
            "position": smooth.position[:, joint],
        }
        rows_of = {name: smooth.rows(values)[counting] for name, values in series.items()}
        parts.append({**rows_of, "recording": np.full(int(counting.sum()), number)})
    joined = {name: np.concatenate([rows[name] for rows in parts]) for name in parts[0]}
    rows, names = data.rows[joint], data.prepared.model.base.names
    fit = data.regression.fitted
    of_links = np.array([not names[k].startswith(_NOT_OF_LINKS) for k in rows.columns])
    places = rows.columns[of_links]
    columns = rows.matrix[:, of_links][np.concatenate(taken)]
    fitted = fit.values if values is None else values
    # The motion holds the parameters of another estimator.
    joined["load"] += columns @ (fitted - data.estimate.linear.values)[places]
    return TwistRows(
        joint=joint,
        channels=tuple(channels),
        **joined,
        segments=segments_of([counting for _, counting in channels]),
        load_columns=columns,
        load_covariance=fit.covariance[np.ix_(places, places)],
        resolution=_resolution(data, joint),
    )


def _resolution(data: Baseline, joint: int) -> float:
    """Step of the coarser of the two encoders, rad; zero where values lie on no grid."""
    steps = [0.0]
    for motion in data.prepared.motions:
        signals = motion.signals
        assert signals.link_position is not None
        for values in (signals.position[:, joint], signals.link_position[:, joint]):
            apart = np.diff(np.unique(np.round(values, 12)))
            ratios = apart / apart.min(initial=np.inf)
            if len(apart) and np.abs(ratios - np.round(ratios)).max() < _STEP_TOLERANCE:
                steps.append(float(apart.min()))
    return max(steps)


@dataclass(frozen=True)
class TwistFit:
    """What one joint's twist follows.

    `offset`, `offset_std`: time by which the link's channel is late, s; `columns` (r, k): of every
    term that was tried; `chosen`: those that are accepted beside the time offset and the constants,
    in the order of the columns; `numbers`: coefficient and deviation of a term, rad per unit of the
    column, beside the accepted ones (position has none); `regression`, `fit`: of the accepted
    terms.
    """

    rows: TwistRows
    offset: float
    offset_std: float
    columns: dict[str, FloatArray]
    selection: Selection
    chosen: dict[str, Term]
    numbers: dict[str, tuple[float, float]]
    regression: Regression
    fit: Fit

    def accepted(self, term: str) -> float:
        """Coefficient of a term that is in the model; zero of any other."""
        return self.numbers[term][0] if term in self.chosen else 0.0

    def evidence(self, term: str) -> Evidence:
        """Why a term of the model is believed."""
        folds, of_term = chosen_without(self.selection), self.chosen[term]
        times = f"{folds.times(of_term)} of {len(folds.keys)}"
        return Evidence(2.0 * of_term.evidence, chosen_in_folds=times)

    def clear(self, term: str) -> bool:
        """Whether a term is in the model, and positive beyond noise."""
        value, std = self.numbers.get(term, (0.0, 0.0))
        return term in self.chosen and value > settings.CLEAR_DEVIATIONS * std

    @property
    def twist(self) -> FloatArray:
        """(r,) rad with both channels at the same instants, less constants and position."""
        followed = [self.columns[t][:, 0] * self.accepted(t) for t in self.chosen if t != POSITION]
        return np.asarray(sum(followed, self.fit.residuals[0]))


def fit_twist(rows: TwistRows) -> TwistFit:
    """Align the two channels and find what their difference follows."""
    columns = {LOAD: rows.load[:, None], DIRECTION: rows.direction[:, None]}
    if min(np.mean(rows.side < 0.0), np.mean(rows.side > 0.0)) >= _LEAST_SIDE:
        columns[SIDE] = rows.side[:, None]
    turn = rows.position - rows.position.min()
    turn = np.pi * turn / max(float(turn.max()), 1e-12)
    columns[POSITION] = np.cos(turn[:, None] * np.arange(1, _POSITION_TERMS + 1))
    columns[RATE] = rows.load_rate[:, None]
    offset = 0.0
    for _ in range(_OFFSET_STEPS):
        fit = _regression(rows, offset).with_columns({0: columns[LOAD]}).fit()
        offset += float(fit.values[0])
    selection, chosen = _chosen(rows, offset, columns)
    terms = list(chosen)
    blocks = [{0: columns[term]} for term in terms]
    regression = _regression(rows, offset).with_columns(*blocks)
    fit, numbers = regression.fit(), {}
    for term in columns:
        if term == POSITION or (term == RATE and LOAD not in terms):
            continue
        wider, place = fit, -1
        if term in terms:
            place = regression.blocks[terms.index(term)].start
        else:
            wider = regression.with_columns({0: columns[term]}).fit()
        variance = float(wider.coefficient_covariance[place, place])
        numbers[term] = float(wider.coefficients[place]), float(np.sqrt(max(variance, 0.0)))
    late, late_std = float(fit.values[0]), float(np.sqrt(max(fit.covariance[0, 0], 0.0)))
    offset += late
    return TwistFit(rows, offset, late_std, columns, selection, chosen, numbers, regression, fit)


def _regression(rows: TwistRows, offset: float) -> Regression:
    """Regress the twist on the speed and a constant for each recording."""
    matrix = np.column_stack([rows.speed, rows.constants])
    places = np.arange(matrix.shape[1])
    joint = JointRows(matrix, rows.twist(offset), places, rows.segments)
    return Regression((joint,), len(places))


def _chosen(
    rows: TwistRows, offset: float, columns: dict[str, FloatArray]
) -> tuple[Selection, dict[str, Term]]:
    """Terms that the comparison asks for, in the order of the columns."""
    twist = rows.twist(offset)
    size = float(np.std(independent_basis(rows.constants).remove(twist))) or 1e-300
    late = FREE * size / max(rms(rows.speed), 1e-300)
    ledger = ledger_of_rows(
        twist, size, rows.speed[:, None], np.array([late]), rows.constants, rows.segments
    )
    selection = select(NamedColumns(columns, acts_with={RATE: LOAD}), ledger)
    odds = float(np.log(settings.PRESENCE / (1.0 - settings.PRESENCE)))
    kept = supported(selection.comparison, selection.terms, odds)
    by_name = {term.key.effect: term for term in kept}
    if LOAD not in by_name:
        by_name.pop(RATE, None)
    return selection, {name: by_name[name] for name in columns if name in by_name}


def compliance(fit: TwistFit) -> tuple[float, float]:
    """1/K and its standard deviation (rad/(N m)).

    The deviation holds the noise of the twist, by how much blocks of time differ beyond it, the
    parameters of the links, and an error over the position that the twist allows and does not ask
    for.
    """
    value, noise = fit.numbers[LOAD]
    variance = noise**2 + _load_variance(fit)
    if LOAD in fit.chosen:
        variance += noise**2 * (fit.chosen[LOAD].dispersion - 1.0)
        if POSITION not in fit.chosen:
            wider = fit.regression.with_columns({0: fit.columns[POSITION]}).fit()
            variance += (float(wider.coefficients[list(fit.chosen).index(LOAD)]) - value) ** 2
    return value, float(np.sqrt(variance))


def _load_variance(fit: TwistFit) -> float:
    """Variance of 1/K from the parameters of the links: its gradient along each of them."""
    rows = fit.rows
    noise, joint = fit.fit.noise_models[0], fit.regression.joints[0]
    others = [joint.matrix, *(fit.columns[term] for term in fit.chosen if term != LOAD)]
    nuisance = independent_basis(noise.standardized(np.column_stack(others), rows.segments))
    load, changes, twist = (
        nuisance.remove(noise.standardized(values, rows.segments))
        for values in (rows.load, rows.load_columns, joint.torque)
    )
    energy = float(load @ load)
    if energy <= 0.0:
        return 0.0
    value = float(load @ twist) / energy
    gradient = (changes.T @ twist - 2.0 * value * (changes.T @ load)) / energy
    return float(np.maximum(gradient @ rows.load_covariance @ gradient, 0.0))
