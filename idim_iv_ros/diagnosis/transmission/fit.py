"""What a twist follows: the load, its side, the direction, the position, the speed.

twist = load / K + (gap / 2) sign(load) + h sign(speed) + s · speed − (D / K²) d(load)/dt + g(q) + c

K is the stiffness, D the damping, s the time by which the link's channel is late: that is no
elasticity, and always in the model. h is play that friction keeps on one side, or friction
behind the gear. g is an error of an encoder that depends on the position. What is not always
there is added one by one, the best first, as long as Schwarz's criterion asks for it with the
margin of every other search here. Rows are whitened by an autoregressive model of the residual.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.likelihood import Fit, Regression
from idim_iv_ros.diagnosis.transmission.twist import TwistRows
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.statistics.hypothesis import HypothesisTest
from idim_iv_ros.types import BoolArray, FloatArray

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
        Coefficient and its deviation, rad per unit of the column: of terms that are not accepted
        beside those that are. Position has none.
    gains : dict of term to float
        Logarithm of the likelihood ratio of each, less Schwarz's penalty.
    regression, fit
        Of the accepted terms.
    """

    rows: TwistRows
    offset: float
    offset_std: float
    columns: dict[str, FloatArray]
    terms: tuple[str, ...]
    numbers: dict[str, tuple[float, float]]
    gains: dict[str, float]
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
        followed = [self.columns[t][:, 0] * self.numbers[t][0] for t in self.terms if t != POSITION]
        return np.asarray(sum(followed, self.fit.residuals[0]))


def fit_twist(rows: TwistRows) -> TwistFit:
    """Align the two channels and find what their difference follows."""
    columns = _term_columns(rows)
    offset = 0.0
    for _ in range(_OFFSET_STEPS):
        fit = _base(rows, offset).with_columns({0: columns[LOAD]}).fit()
        offset += float(fit.values[0])
    base = _base(rows, offset)
    terms, gains = _selected(base, columns)
    regression = _with_terms(base, [columns[term] for term in terms])
    fit = regression.fit()
    numbers = {}
    for term in gains:
        if term == POSITION:
            continue
        wider, before = fit, terms
        if term in terms:
            before = terms[: terms.index(term)]
        else:
            wider = regression.with_columns({0: columns[term]}).fit()
        place = sum(columns[other].shape[1] for other in before)
        variance = float(wider.coefficient_covariance[place, place])
        numbers[term] = float(wider.coefficients[place]), float(np.sqrt(max(variance, 0.0)))
    return TwistFit(
        rows=rows,
        offset=offset + float(fit.values[0]),
        offset_std=float(np.sqrt(max(fit.covariance[0, 0], 0.0))),
        columns=columns,
        terms=tuple(terms),
        numbers=numbers,
        gains=gains,
        regression=regression,
        fit=fit,
    )


def _term_columns(rows: TwistRows) -> dict[str, FloatArray]:
    """Columns (r, k) of every term that need not be there."""
    columns = {LOAD: rows.load[:, None], DIRECTION: rows.direction[:, None]}
    sides = [float(np.mean(rows.side * sign > 0.0)) for sign in (-1.0, 1.0)]
    if min(sides) >= _LEAST_SIDE:
        columns[SIDE] = rows.side[:, None]
    span = max(float(np.ptp(rows.position)), 1e-12)
    turn = np.pi * (rows.position - rows.position.min()) / span
    columns[POSITION] = np.cos(turn[:, None] * np.arange(1, _POSITION_TERMS + 1))
    columns[RATE] = rows.load_rate[:, None]
    return columns


def _base(rows: TwistRows, offset: float) -> Regression:
    """Speed and a constant for each recording."""
    constants = rows.recording[:, None] == np.unique(rows.recording)
    matrix = np.column_stack([rows.speed, constants.astype(float)])
    places = np.arange(matrix.shape[1])
    joint = JointRows(matrix, rows.twist(offset), places, rows.segments)
    return Regression((joint,), len(places))


def _selected(
    base: Regression, columns: Mapping[str, FloatArray]
) -> tuple[list[str], dict[str, float]]:
    """Terms that the likelihood asks for, and what each brings beside those."""
    terms: list[str] = []
    while True:
        gains = _gains(base, columns, terms)
        others = [term for term in gains if term not in terms]
        best = max(others, key=lambda term: gains[term], default=None)
        if best is None or gains[best] < settings.LEAST_SUPPORT:
            break
        terms.append(best)
    # What came first may be explained by what came later.
    for term in list(terms):
        gains = _gains(base, columns, terms)
        if term != RATE and gains[term] < settings.LEAST_SUPPORT:
            terms.remove(term)
    if LOAD not in terms and RATE in terms:
        terms.remove(RATE)
    return terms, _gains(base, columns, terms)


def _gains(
    base: Regression, columns: Mapping[str, FloatArray], terms: Sequence[str]
) -> dict[str, float]:
    """Of every term beside the other accepted ones, less Schwarz's penalty."""
    gains = {}
    for term, column in columns.items():
        if term == RATE and LOAD not in terms:
            continue
        others = [columns[other] for other in terms if other != term]
        regression = _with_terms(base, [*others, column])
        penalty = 0.5 * column.shape[1] * np.log(len(column))
        gains[term] = regression.gain_of_last(regression.fit()) - float(penalty)
    return gains


def _with_terms(base: Regression, blocks: Sequence[FloatArray]) -> Regression:
    for block in blocks:
        base = base.with_columns({0: block})
    return base


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


def held_out(fit: TwistFit, term: str) -> tuple[float | None, int, int]:
    """Share of the whitened twist's energy that a term takes on blocks that were not fitted.

    Blocks lie at the same places of every recording: its constant is fitted from the others.

    Returns
    -------
    float or None
        None where there are too few rows.
    int, int
        On how many blocks it helps, of how many.
    """
    rows, regression, count = fit.rows, fit.regression, int(settings.FOLDS)
    first = regression.parameters + sum(regression.widths[: fit.terms.index(term)])
    joint = regression.extended[0]
    table = np.column_stack([joint.matrix, joint.torque])
    table = fit.fit.noise_models[0].whiten(table, rows.segments)
    without = np.delete(table, first, axis=1)
    block = np.zeros(len(table), dtype=np.int64)
    for number in np.unique(rows.recording):
        places = np.flatnonzero(rows.recording == number)
        block[places] = np.arange(len(places)) * count // len(places)
    before, after = (
        np.array([_predicted(some, block == k) for k in range(count)]) for some in (without, table)
    )
    gain = float(1.0 - after.sum() / before.sum()) if before.sum() > 0.0 else None
    return gain, int(np.sum(after < before)), count


def _predicted(table: FloatArray, out: BoolArray) -> float:
    """Energy of what a fit to the other rows of [X y] misses in those that are `out`."""
    solution = np.linalg.lstsq(table[~out, :-1], table[~out, -1], rcond=None)[0]
    return float(np.sum((table[out, -1] - table[out, :-1] @ solution) ** 2))
