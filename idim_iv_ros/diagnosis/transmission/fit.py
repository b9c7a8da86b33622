"""What a twist follows: the load, its side, the direction, the position, the speed.

twist = load / K + (gap / 2) sign(load) + h sign(speed) + s · speed − (D / K²) d(load)/dt + g(q) + c

K is the stiffness, D the damping, s the time by which the link's channel is late: that is no
elasticity, and always in the model. h is play that friction keeps on one side, or friction
behind the gear. g is an error of an encoder that depends on the position. What is not always
there is chosen by the comparison that chooses causes. Rows are whitened by an autoregressive model
of the residual.
"""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.comparison.named_columns import (
    FREE,
    NamedColumns,
    ledger_of_rows,
    supported,
)
from idim_iv_ros.diagnosis.comparison.select import select
from idim_iv_ros.diagnosis.likelihood import Fit, Regression
from idim_iv_ros.diagnosis.refit.held_out import predicted
from idim_iv_ros.diagnosis.result import Evidence
from idim_iv_ros.diagnosis.transmission.twist import TwistRows
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.statistics.hypothesis import HypothesisTest
from idim_iv_ros.types import FloatArray

_OFFSET_STEPS = 3  # fits of the time offset, which enters to first order only
_POSITION_TERMS = 4  # cosines of an encoder's error: slower than that of a gear
_LEAST_SIDE = 0.05  # of the rows on either side of zero load, to look for play

LOAD, SIDE, DIRECTION, POSITION, RATE = "load", "side", "direction", "position", "load rate"


@dataclass(frozen=True)
class TwistFit:
    """What one joint's twist follows.

    Attributes
    ----------
    rows : TwistRows
    offset, offset_std : float
        Time by which the link's channel is late, s.
    columns : dict of term to (r, k)
        Of every term that was tried.
    terms : tuple of str
        Accepted beside the time offset and the constants.
    numbers : dict of term to (float, float)
        Coefficient and its deviation, rad per unit of the column, beside the accepted terms.
        Position has none.
    regression, fit
        Of the accepted terms.
    """

    rows: TwistRows
    offset: float
    offset_std: float
    columns: dict[str, FloatArray]
    terms: tuple[str, ...]
    numbers: dict[str, tuple[float, float]]
    regression: Regression
    fit: Fit

    def accepted(self, term: str) -> float:
        """Coefficient of a term that is in the model; zero of any other."""
        return self.numbers[term][0] if term in self.terms else 0.0

    def clear(self, term: str) -> bool:
        """Whether a term is in the model, and positive beyond noise."""
        value, std = self.numbers.get(term, (0.0, 0.0))
        return term in self.terms and value > settings.CLEAR_DEVIATIONS * std

    @property
    def twist(self) -> FloatArray:
        """(r,) rad with both channels at the same instants, less constants and position."""
        followed = [self.columns[t][:, 0] * self.accepted(t) for t in self.terms if t != POSITION]
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
    terms = _chosen(rows, offset, columns)
    regression = _regression(rows, offset)
    for term in terms:
        regression = regression.with_columns({0: columns[term]})
    fit, numbers = regression.fit(), {}
    for term in columns:
        if term == POSITION or (term == RATE and LOAD not in terms):
            continue
        wider, place = fit, -1
        if term in terms:
            place = sum(regression.widths[: terms.index(term)])
        else:
            wider = regression.with_columns({0: columns[term]}).fit()
        variance = float(wider.coefficient_covariance[place, place])
        numbers[term] = float(wider.coefficients[place]), float(np.sqrt(max(variance, 0.0)))
    late, late_std = float(fit.values[0]), float(np.sqrt(max(fit.covariance[0, 0], 0.0)))
    return TwistFit(rows, offset + late, late_std, columns, terms, numbers, regression, fit)


def _regression(rows: TwistRows, offset: float) -> Regression:
    """Regress the twist on the speed and a constant for each recording."""
    matrix = np.column_stack([rows.speed, rows.constants])
    places = np.arange(matrix.shape[1])
    joint = JointRows(matrix, rows.twist(offset), places, rows.segments)
    return Regression((joint,), len(places))


def _chosen(rows: TwistRows, offset: float, columns: dict[str, FloatArray]) -> tuple[str, ...]:
    """Terms that the comparison asks for, in the order of the columns."""
    twist = rows.twist(offset)
    means = np.linalg.lstsq(rows.constants, twist)[0]
    size = float(np.std(twist - rows.constants @ means)) or 1e-300
    late = FREE * size / max(float(np.sqrt(np.mean(rows.speed**2))), 1e-300)
    ledger = ledger_of_rows(
        twist, size, rows.speed[:, None], np.array([late]), rows.constants, rows.segments
    )
    selection = select(NamedColumns(columns, acts_with={RATE: LOAD}), ledger)
    odds = float(np.log(settings.PRESENCE / (1.0 - settings.PRESENCE)))
    kept = supported(selection.comparison, selection.terms, odds)
    names = {term.key[0] for term in kept}
    if LOAD not in names:
        names.discard(RATE)
    return tuple(name for name in columns if name in names)


def compliance(fit: TwistFit) -> tuple[float, float, HypothesisTest]:
    """1/K, its standard deviation (rad/(N m)), and whether all parts of the recording agree.

    The deviation holds the noise of the twist, the parameters of the links, an error over the
    position that the twist allows and does not ask for, and by how much the parts of the
    recording differ beyond noise (Birge's ratio).
    """
    value, noise = fit.numbers[LOAD]
    test, ratio = _agreement(fit)
    variance = noise**2 * max(1.0, ratio) + _load_variance(fit)
    if POSITION not in fit.terms and LOAD in fit.terms:
        wider = fit.regression.with_columns({0: fit.columns[POSITION]}).fit()
        variance += (float(wider.coefficients[fit.terms.index(LOAD)]) - value) ** 2
    return value, float(np.sqrt(variance)), test


def _load_variance(fit: TwistFit) -> float:
    """Variance of 1/K from the parameters of the links: its gradient along each of them."""
    rows = fit.rows
    noise, joint = fit.fit.noise_models[0], fit.regression.joints[0]
    others = [joint.matrix, *(fit.columns[term] for term in fit.terms if term != LOAD)]
    nuisance = np.linalg.qr(noise.standardized(np.column_stack(others), rows.segments))[0]

    def rest(values: FloatArray) -> FloatArray:
        white = noise.standardized(values, rows.segments)
        return white - nuisance @ (nuisance.T @ white)

    load, changes, twist = rest(rows.load), rest(rows.load_columns), rest(joint.torque)
    energy = float(load @ load)
    if energy <= 0.0:
        return 0.0
    value = float(load @ twist) / energy
    gradient = (changes.T @ twist - 2.0 * value * (changes.T @ load)) / energy
    return float(np.maximum(gradient @ rows.load_covariance @ gradient, 0.0))


def _agreement(fit: TwistFit) -> tuple[HypothesisTest, float]:
    """H0: one compliance for every recording (of one, for both halves); χ² over its df."""
    part, words = fit.rows.recording, "all recordings"
    if len(np.unique(part)) < 2:
        part = (np.arange(len(part)) >= len(part) // 2).astype(np.int64)
        words = "both halves of the recording"
    words = f"one compliance holds for {words}"
    if LOAD not in fit.terms:
        return HypothesisTest.not_run(words, "all", "no twist follows the load"), 1.0
    blocks = fit.rows.load[:, None] * (part[:, None] == np.unique(part)[1:])
    wider = fit.regression.with_columns({0: blocks}).fit()
    added = slice(len(wider.coefficients) - blocks.shape[1], None)
    change, covariance = wider.coefficients[added], wider.coefficient_covariance[added, added]
    df = int(np.linalg.matrix_rank(covariance))
    if df == 0:
        return HypothesisTest.not_run(words, "all", "the load moves in one part only"), 1.0
    statistic = float(change @ np.linalg.pinv(covariance) @ change)
    p_value = float(stats.chi2.sf(statistic, df))
    return HypothesisTest(words, "all", statistic, df, None, p_value, alpha=0.01), statistic / df


def evidence_of(fit: TwistFit, term: str) -> Evidence:
    """How a term predicts blocks that were not fitted.

    Blocks lie at the same places of every recording: its constant is fitted from the others.
    """
    rows, count = fit.rows, int(settings.FOLDS)
    regression = Regression(fit.regression.joints, fit.regression.parameters)
    for other in [*(other for other in fit.terms if other != term), term]:
        regression = regression.with_columns({0: fit.columns[other]})
    block = np.zeros(len(rows.load), dtype=np.int64)
    for number in np.unique(rows.recording):
        places = np.flatnonzero(rows.recording == number)
        block[places] = np.arange(len(places)) * count // len(places)
    ends = np.array([regression.total - regression.widths[-1], regression.total])
    before, after = (
        np.maximum(np.bincount(block, residual**2, count), 1e-300)
        for (residual,) in predicted(regression, fit.fit.noise_models, [block], ends)
    )
    left = float(after.sum() / before.sum())
    helped = int(np.sum(after < before))
    return Evidence(-len(block) * float(np.log(left)), None, 1.0 - left, f"{helped} of {count}")
