"""Shafts and play that encoders behind the gears measure, as results and as causes.

How far each motor is ahead of its link follows the torque that its gear transmits. That torque is
the load: that of the links alone, from the refit. The measured effort would not do. It holds
friction, of which nobody knows how much lies before the gear and how much behind, and noise, which
makes every shaft look stiffer than it is. What friction behind the gear twists follows the
direction of motion and the speed, and is kept apart by that.

twist = load / K + (gap / 2) sign(load) + h sign(speed) + s · speed − (D / K²) d(load)/dt + g(q) + c

K is the stiffness, D the damping, s the time by which the link's channel is late: that is no
elasticity, and always in the model. h is play that friction keeps on one side, or friction
behind the gear. g is an error of an encoder that depends on the position. What is not always
there is chosen by the comparison that chooses causes. Rows are whitened by an autoregressive model
of the residual.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import binary_dilation

from idim_iv_ros.diagnosis import sentences, settings
from idim_iv_ros.diagnosis.comparison.folds import chosen_without
from idim_iv_ros.diagnosis.comparison.model_with_terms import Term
from idim_iv_ros.diagnosis.comparison.named_columns import (
    FREE,
    NamedColumns,
    ledger_of_rows,
    supported,
)
from idim_iv_ros.diagnosis.comparison.select import Selection, select
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result.causes import Cause, Evidence, Gap
from idim_iv_ros.diagnosis.result.recordings import Transmission, TransmissionSeries
from idim_iv_ros.effects.cause import EffectParameter, Part
from idim_iv_ros.effects.registry import name_of, part_of
from idim_iv_ros.effects.two_masses import transmitted
from idim_iv_ros.estimation.likelihood import Fit, Regression, rms
from idim_iv_ros.estimation.observation import segments_of
from idim_iv_ros.estimation.qr import independent_basis
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.identification.sanity import JointFinding, link_findings
from idim_iv_ros.signals.filters import shifted
from idim_iv_ros.signals.motion import Motion, all_around
from idim_iv_ros.types import BoolArray, FloatArray

_LINK_MOTION_STEPS = 3  # times that the load is computed again at the link's motion
_STEP_TOLERANCE = 0.01  # steps: up to here an encoder's values lie on a grid
_ON_ONE_SIDE = 0.98  # decimated sign of the load from which a link in play lies on one side
_SIDE_MARGIN = 2  # rows beside a change of side: the link flies there
# Base parameters that are none of the links.
_NOT_OF_LINKS = ("Fv", "Fc", "off", "Ia")
_OFFSET_STEPS = 3  # fits of the time offset, which enters to first order only
_POSITION_TERMS = 4  # cosines of an encoder's error: slower than that of a gear
_LEAST_SIDE = 0.05  # of the rows on either side of zero load, to look for play
_LEAST_VARIATION = 0.01  # of the largest load: a smaller deviation shows no stiffness
_LIGHT_DAMPING = 0.03  # times critical, of a shaft where none shows
# Hz, of the link against its motor: a shaft is rigid above what the catalogue looks for.
_STIFF_RESONANCE = 100.0
# Play counts as play, and not as part of a shaft, from this share of the shaft's largest bending:
# as `effects.backlash`.
_WIDE = 0.3

_LOAD, _SIDE, _DIRECTION, _POSITION, _RATE = "load", "side", "direction", "position", "load rate"
_SIGNALS = ("load", "load_rate", "side", "speed", "direction", "position")  # of `TwistRows`


@dataclass(frozen=True)
class Measured:
    """One transmission: what is reported of it, and the fit behind that (None without one)."""

    joint: int
    result: Transmission
    fit: "TwistFit | None" = None

    @property
    def series(self) -> TransmissionSeries | None:
        """Twist over load for the figure."""
        if self.fit is None:
            return None
        rows, fit = self.fit.rows, self.fit
        followed = fit.accepted(_LOAD) * rows.load + fit.accepted(_SIDE) * rows.side
        twist = followed + fit.fit.residuals[0]
        return TransmissionSeries(self.result.joint, rows.load, twist, rows.direction)


def measured_transmissions(data: Baseline) -> tuple[Measured, ...]:
    """Measure every joint that has an encoder behind its gear."""
    encoders = link_findings(data.prepared.motions, data.prepared.model.robot.joint_types)
    return tuple(_measured(data, encoder) for encoder in encoders)


def _measured(data: Baseline, encoder: JointFinding) -> Measured:
    joint, name = encoder.joint, data.joints[encoder.joint]
    rows = _twist_rows(data, joint)
    reason, count = encoder.sentence if encoder.level == "limited" else "", len(rows.load)
    if count < settings.LEAST_ROWS:
        longer = "record for longer, with this joint moving"
        reason = f"only {count} rows of the encoder behind the gear count: {longer}"
    if reason:
        return Measured(joint, Transmission(joint=name, reason=reason))
    fit = fit_twist(rows)
    for _ in range(_LINK_MOTION_STEPS):
        if not fit.clear(_LOAD):
            break
        # With the load of links that move as the shaft lets them, refitted as such: a refit that
        # takes the motor's motion for theirs finds heavier links.
        bending, rate = fit.accepted(_LOAD), fit.accepted(_RATE)
        damping = -rate / bending**2 if rate < 0.0 else None
        gap = 2.0 * max(fit.accepted(_SIDE), 0.0)
        elastic = _without_twist(data, joint, 1.0 / bending, damping, gap)
        links = elastic.fit(data.regression.fitted.noise_models).values
        fit = fit_twist(_twist_rows(data, joint, bending, links))
        if _SIDE in fit.chosen:
            fit = fit_twist(fit.rows.away_from_side_changes())
    return Measured(joint, _transmission(data, joint, fit), fit)


def with_transmissions(
    data: Baseline,
    measured: Sequence[Measured],
    causes: Sequence[Cause],
    without: Collection[str] = (),
) -> tuple[list[Cause], list[Cause], list[str]]:
    """Put measured shafts and play in place of those that the torque alone suggests.

    Where both name one, it is one cause, with the measured numbers and the torque gap of the other.
    What the encoder behind a gear excludes at 95 % is taken out, with a note. Returns all causes,
    those of them that were measured, and the notes.
    """
    kept, shafts, notes = list(causes), [], []
    for transmission in measured:
        result = transmission.result
        suggested = [
            cause
            for cause in kept
            if cause.joint == result.joint and part_of(cause.effect) in ("shaft", "play")
        ]
        part = _part(data, transmission)
        if part and name_of(part) not in without:
            cause = _cause(data, transmission, part)
            if suggested:
                gaps = ("torque_gap", "joint_gaps", "simulation_gap")
                cause = replace(cause, **{name: getattr(suggested[0], name) for name in gaps})
            kept = [cause, *(other for other in kept if other not in suggested)]
            shafts.append(cause)
            continue
        most = np.inf if result.backlash_at_most is None else result.backlash_at_most
        for cause in suggested:
            if part_of(cause.effect) == "play":
                excluded = cause.parameters["gap"].value > most
            else:
                excluded = cause.parameters["stiffness"].value < (result.stiffness_at_least or 0.0)
            if excluded:
                kept.remove(cause)
                notes.append(
                    f"on the torque alone an {cause.effect} at {result.joint} would help; the "
                    "encoder behind the gear excludes one of that size "
                    f"({sentences.transmission(result)})"
                )
    return kept, shafts, notes


def _part(data: Baseline, transmission: Measured) -> Part:
    """What a measured transmission is, a shaft or play; empty where nothing matters in it."""
    result, fit = transmission.result, transmission.fit
    if fit is None:
        return ""
    stiffness = np.inf if result.stiffness is None else result.stiffness.value
    bending = float(np.abs(fit.rows.load).max()) / stiffness
    if result.backlash is not None and result.backlash.value > _WIDE * bending:
        return "play"
    # Of the link against a motor at rest, median over the motion.
    resonance = np.sqrt(stiffness / _link_inertia(data, transmission.joint)) / (2.0 * np.pi)
    return "" if resonance > _STIFF_RESONANCE else "shaft"


def _cause(data: Baseline, transmission: Measured, part: Part) -> Cause:
    """Name a measured shaft or play, with the residual of the refit at the joint as its gap.

    The transmission is not fitted to the torque; the base parameters are, without and with it.
    """
    result, fit, joint = transmission.result, transmission.fit, transmission.joint
    assert fit is not None
    stiffness, damping = result.stiffness, result.damping
    gap = result.backlash if part == "play" else None
    if stiffness is None and result.stiffness_at_least is not None:
        unit = data.unit_at(joint, "N m/rad")
        stiffness = EffectParameter(result.stiffness_at_least, None, unit)
    named = {"gap": gap, "stiffness": stiffness, "damping": damping}
    before = after = data.regression.fitted
    if stiffness is not None:
        damped = None if damping is None else damping.value
        play = 0.0 if gap is None else gap.value
        elastic = _without_twist(data, joint, stiffness.value, damped, play)
        after = elastic.fit(before.noise_models, steps=0)
    one, two = (rms(fitted.residuals[joint]) for fitted in (before, after))
    term, folds = fit.chosen[_SIDE if part == "play" else _LOAD], chosen_without(fit.selection)
    times = f"{folds.times(term)} of {len(folds.keys)}"
    return Cause(
        effect=name_of(part),
        kind="structural",
        joint=result.joint,
        sentence=sentences.transmission(result, name_of(part)),
        parameters={name: number for name, number in named.items() if number is not None},
        evidence=Evidence(2.0 * term.evidence, chosen_in_folds=times),
        torque_gap=Gap.between(one, two),
        joint_gaps=(data.joint_change(joint, one, two),),
    )


def _link_inertia(data: Baseline, joint: int) -> float:
    """Inertia of what is behind a joint, about it: median over the motion, kg m²."""
    inertia = np.concatenate([motion.inertia[:, joint, joint] for motion in data.motions])
    return max(float(np.median(inertia)), 1e-12)


def _without_twist(
    data: Baseline, joint: int, stiffness: float, damping: float | None, gap: float
) -> Regression:
    """Take off what a transmission changes of the torques against a rigid one.

    `stiffness`, `gap`: N m/rad, rad. `damping`: N m s/rad; None: light, where none was measured.
    """
    if damping is None:
        damping = _LIGHT_DAMPING * 2.0 * float(np.sqrt(stiffness * _link_inertia(data, joint)))
    parts = [transmitted(motion, joint, stiffness, damping, gap) for motion in data.motions]
    joints = list(data.rows)
    for other in parts[0]:
        changed = data.decimated(other, [part[other][:, 0] for part in parts])
        joints[other] = replace(joints[other], torque=joints[other].torque - changed)
    return replace(data.regression, joints=tuple(joints))


def _transmission(data: Baseline, joint: int, fit: "TwistFit") -> Transmission:
    """Everything that the twist of a joint says, with what makes it unsure."""
    rows, angle, (bending, std) = fit.rows, data.unit_at(joint, "rad"), compliance(fit)
    elastic = bending * rows.load
    clear = bending > settings.CLEAR_DEVIATIONS * std
    resolution = _resolution(data, joint)
    seen = float(np.ptp(elastic)) > resolution
    stiffness = damping = most = None
    if _LOAD in fit.chosen and clear and seen:
        stiffness = EffectParameter(1.0 / bending, std / bending**2, data.unit_at(joint, "N m/rad"))
        rate, rate_std = fit.numbers.get(_RATE, (0.0, 0.0))
        if _RATE in fit.chosen and rate < 0.0:  # D = −K² times the coefficient
            value = -rate * stiffness.value**2
            relative = float(np.hypot(rate_std / rate, 2.0 * std / bending))
            if settings.CLEAR_DEVIATIONS * relative < 1.0:
                damping = EffectParameter(value, value * relative, data.unit_at(joint, "N m s/rad"))
    highest = bending + settings.NORMAL_95 * std
    gap, friction = (
        EffectParameter(2.0 * fit.numbers[term][0], 2.0 * fit.numbers[term][1], angle)
        if fit.clear(term)
        else None
        for term in (_SIDE, _DIRECTION)
    )
    if _SIDE in fit.numbers:
        side, side_std = fit.numbers[_SIDE]
        most = 2.0 * (max(side, 0.0) + settings.NORMAL_95 * side_std)
    # With both channels at the same instants, less constants and position.
    followed = [fit.columns[t][:, 0] * fit.accepted(t) for t in fit.chosen if t != _POSITION]
    total = float(np.var(sum(followed, fit.fit.residuals[0]))) or 1e-300
    return Transmission(
        joint=data.joints[joint],
        stiffness=stiffness,
        stiffness_at_least=1.0 / highest if highest > 0.0 else None,
        damping=damping,
        backlash=gap if gap is not None and gap.value > resolution else None,
        backlash_at_most=most,
        lost_motion=friction,
        time_offset=EffectParameter(fit.offset, fit.offset_std, "s"),
        position_error=_POSITION in fit.chosen,
        elastic_share=min(1.0, float(np.var(elastic)) / total) if stiffness is not None else 0.0,
        resolution=resolution,
        rows=len(rows.load),
        unit=angle,
        reason="" if stiffness else _undecided(fit, resolution, clear=clear, seen=seen),
    )


def _undecided(fit: "TwistFit", resolution: float, *, clear: bool, seen: bool) -> str:
    """Why no stiffness is said; `clear`, `seen`: whether the twist exceeds noise, and a step."""
    rows = fit.rows
    # Whether a twist of one step of the encoders would not have been significant.
    step = resolution / max(float(np.ptp(rows.load)), 1e-300)
    hidden = step <= settings.CLEAR_DEVIATIONS * fit.numbers[_LOAD][1]
    if resolution > 0.0 and (_LOAD in fit.chosen or hidden) and not seen:
        return (
            f"the twist under the load stays below the encoders' step of {resolution:.2g}: "
            "it cannot be determined"
        )
    if float(np.std(rows.load)) <= _LEAST_VARIATION * max(float(np.abs(rows.load).max()), 1e-300):
        return "the load hardly varies: it cannot be determined"
    if _LOAD in fit.chosen and not clear:
        return "what the encoders' errors and the load's leave open is as large as the twist"
    return "no twist follows the load"


@dataclass(frozen=True)
class TwistRows:
    """Rows of one joint over all recordings; (r,) each."""

    joint: int
    # Recordings with positions before and behind the gear, and their samples (m,) that count.
    channels: tuple[tuple[Motion, BoolArray], ...]
    load: FloatArray  # torque of the links, N m, from the refit
    load_rate: FloatArray
    side: FloatArray  # sign of the load
    speed: FloatArray
    direction: FloatArray  # sign of the speed, between −1 and 1 while the joint sticks
    position: FloatArray
    load_columns: FloatArray  # (r, b) change of the load with each base parameter of the links
    constants: FloatArray  # (r, recordings), one column each
    segments: tuple[slice, ...]
    load_covariance: FloatArray  # (b, b) of the base parameters of the links
    chosen: BoolArray | None = None  # which of the samples that count the rows are; None: all

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
            chosen[segment] = ~binary_dilation(near[segment], iterations=_SIDE_MARGIN)
        names = (*_SIGNALS, "load_columns", "constants")
        changed = {name: getattr(self, name)[chosen] for name in names}
        segments = segments_of([chosen[segment] for segment in self.segments])
        return replace(self, **changed, segments=segments, chosen=chosen)


def _twist_rows(
    data: Baseline, joint: int, bending: float = 0.0, values: FloatArray | None = None
) -> TwistRows:
    """Rows of one joint, where both encoders were read.

    `bending`: compliance of the shaft, rad/(N m), as far as it is known: the link needs the torque
    of its own motion, which is the motor's less the twist; `values`: (b,) base parameters of the
    links, where those of the refit are not: it takes the motor's motion for theirs.
    """
    channels, tables, read = [], [], []
    for motion, smooth in zip(data.prepared.motions, data.motions, strict=True):
        assert motion.signals.link_valid is not None
        valid = motion.signals.link_valid[motion.span, joint : joint + 1]
        read.append(all_around(valid, motion.decimation, motion.decimation.factor)[:, 0])
        channels.append((motion, motion.kept[:, joint] & read[-1]))
        load = smooth.load[:, joint]
        for _ in range(_LINK_MOTION_STEPS if bending > 0.0 else 0):
            behind = smooth.moved(joint, -bending * load, links=True)
            load = smooth.load[:, joint] + behind[:, joint]
        of_load = load, np.gradient(load, 1.0 / smooth.rate), np.sign(load)
        states = (smooth.velocity, smooth.slip, smooth.position)
        tables.append(np.column_stack([*of_load, *(state[:, joint] for state in states)]))
    both = data.counting(joint, read)  # rows at which both encoders were read
    joined = dict(zip(_SIGNALS, data.decimated(joint, tables)[both].T, strict=True))
    recording = data.recordings[joint][both]
    rows, names = data.rows[joint], data.prepared.model.base.names
    fit = data.regression.fitted
    of_links = np.array([not names[k].startswith(_NOT_OF_LINKS) for k in rows.columns])
    places = rows.columns[of_links]
    columns = rows.matrix[:, of_links][both]
    fitted = fit.values if values is None else values
    # The motion holds the parameters of another estimator.
    joined["load"] += columns @ (fitted - data.estimate.linear.values)[places]
    return TwistRows(
        joint=joint,
        channels=tuple(channels),
        **joined,
        constants=np.asarray(recording[:, None] == np.unique(recording), dtype=float),
        segments=segments_of([counting for _, counting in channels]),
        load_columns=columns,
        load_covariance=fit.covariance[np.ix_(places, places)],
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
    """What one joint's twist follows."""

    rows: TwistRows
    offset: float  # time by which the link's channel is late, s
    offset_std: float
    columns: dict[str, FloatArray]  # (r, k) of every term that was tried
    selection: Selection
    chosen: dict[str, Term]  # accepted beside the time offset and the constants, as the columns
    # Coefficient and deviation of a term, rad per unit of its column, beside the accepted ones.
    numbers: dict[str, tuple[float, float]]  # position has none
    regression: Regression  # of the accepted terms
    fit: Fit

    def accepted(self, term: str) -> float:
        """Coefficient of a term that is in the model; zero of any other."""
        return self.numbers[term][0] if term in self.chosen else 0.0

    def clear(self, term: str) -> bool:
        """Whether a term is in the model, and positive beyond noise."""
        value, std = self.numbers.get(term, (0.0, 0.0))
        return term in self.chosen and value > settings.CLEAR_DEVIATIONS * std


def fit_twist(rows: TwistRows) -> TwistFit:
    """Align the two channels and find what their difference follows."""
    columns = {_LOAD: rows.load[:, None], _DIRECTION: rows.direction[:, None]}
    if min(np.mean(rows.side < 0.0), np.mean(rows.side > 0.0)) >= _LEAST_SIDE:
        columns[_SIDE] = rows.side[:, None]
    turn = rows.position - rows.position.min()
    turn = np.pi * turn / max(float(turn.max()), 1e-12)
    columns[_POSITION] = np.cos(turn[:, None] * np.arange(1, _POSITION_TERMS + 1))
    columns[_RATE] = rows.load_rate[:, None]
    speed, constants, segments = rows.speed[:, None], rows.constants, rows.segments

    def regression_at(offset: float) -> Regression:
        """Regress the twist on the speed and a constant for each recording."""
        matrix = np.column_stack([speed, constants])
        places = np.arange(matrix.shape[1])
        return Regression((JointRows(matrix, rows.twist(offset), places, segments),), len(places))

    offset = 0.0
    for _ in range(_OFFSET_STEPS):
        fit = regression_at(offset).with_columns({0: columns[_LOAD]}).fit()
        offset += float(fit.values[0])
    twist = rows.twist(offset)
    size = float(np.std(independent_basis(constants).remove(twist))) or 1e-300
    late = np.array([FREE * size / max(rms(rows.speed), 1e-300)])
    ledger = ledger_of_rows(twist, size, speed, late, constants, segments)
    selection = select(NamedColumns(columns, acts_with={_RATE: _LOAD}), ledger)
    odds = float(np.log(settings.PRESENCE / (1.0 - settings.PRESENCE)))
    kept = supported(selection.comparison, selection.terms, odds)
    by_name = {term.key.effect: term for term in kept}
    if _LOAD not in by_name:
        by_name.pop(_RATE, None)
    chosen = {name: by_name[name] for name in columns if name in by_name}
    regression = regression_at(offset).with_columns(*({0: columns[term]} for term in chosen))
    fit, numbers = regression.fit(), {}
    for term in columns:
        if term == _POSITION or (term == _RATE and _LOAD not in chosen):
            continue
        if term in chosen:
            wider, place = fit, regression.blocks[list(chosen).index(term)].start
        else:
            wider, place = regression.with_columns({0: columns[term]}).fit(), -1
        variance = float(wider.coefficient_covariance[place, place])
        numbers[term] = float(wider.coefficients[place]), float(np.sqrt(max(variance, 0.0)))
    offset += float(fit.values[0])
    offset_std = float(np.sqrt(max(fit.covariance[0, 0], 0.0)))
    return TwistFit(rows, offset, offset_std, columns, selection, chosen, numbers, regression, fit)


def compliance(fit: TwistFit) -> tuple[float, float]:
    """1/K and its standard deviation (rad/(N m)).

    The deviation holds the noise of the twist, by how much blocks of time differ beyond it, the
    parameters of the links, and an error over the position that the twist allows and does not ask
    for.
    """
    value, std = fit.numbers[_LOAD]
    variance, rows = std**2, fit.rows
    noise, joint = fit.fit.noise_models[0], fit.regression.joints[0]
    others = [joint.matrix, *(fit.columns[term] for term in fit.chosen if term != _LOAD)]
    nuisance = independent_basis(noise.standardized(np.column_stack(others), rows.segments))
    load, changes, twist = (
        nuisance.remove(noise.standardized(values, rows.segments))
        for values in (rows.load, rows.load_columns, joint.torque)
    )
    energy = float(load @ load)
    if energy > 0.0:  # the gradient along each parameter of the links
        alone = float(load @ twist) / energy
        gradient = (changes.T @ twist - 2.0 * alone * (changes.T @ load)) / energy
        variance += float(np.maximum(gradient @ rows.load_covariance @ gradient, 0.0))
    if _LOAD in fit.chosen:
        variance += std**2 * (fit.chosen[_LOAD].dispersion - 1.0)
        if _POSITION not in fit.chosen:
            wider = fit.regression.with_columns({0: fit.columns[_POSITION]}).fit()
            variance += (float(wider.coefficients[list(fit.chosen).index(_LOAD)]) - value) ** 2
    return value, float(np.sqrt(variance))
