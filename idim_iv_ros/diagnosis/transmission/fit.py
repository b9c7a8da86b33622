"""What a twist follows: the load, its side, the direction, the position, the speed.

twist = load / K + (gap / 2) sign(load) + h sign(speed) + s · speed − (D / K²) d(load)/dt + g(q) + c

K is the stiffness, D the damping, s the time by which the link's channel is late: that is no
elasticity, and always in the model. h is play that friction keeps on one side, or friction
behind the gear. g is an error of an encoder that depends on the position. What is not always
there is added one by one, the best first, as long as Schwarz's criterion asks for it with the
margin of every other search here. Rows are whitened by an autoregressive model of the residual.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.likelihood import Fit, Regression
from idim_iv_ros.diagnosis.transmission.twist import TwistRows
from idim_iv_ros.estimation.rows import JointRows
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
    terms : tuple of str
        Accepted beside the time offset and the constants.
    coefficients, stds : dict of term to float
        Of every term, rad per unit of its column: of those that are not accepted beside those that
        are. Position has none.
    gains : dict of term to float
        Logarithm of the likelihood ratio of each, less Schwarz's penalty.
    twist : (r,) rad
        With both channels at the same instants, less constants and position.
    residual : (r,) rad
    regression, fit
        Of the accepted terms.
    """

    rows: TwistRows
    offset: float
    offset_std: float
    terms: tuple[str, ...]
    coefficients: dict[str, float]
    stds: dict[str, float]
    gains: dict[str, float]
    twist: FloatArray
    residual: FloatArray
    regression: Regression
    fit: Fit = field(repr=False)

    def accepted(self, term: str) -> bool:
        """Whether a term is in the model."""
        return term in self.terms


def fit_twist(rows: TwistRows) -> TwistFit:
    """Align the two channels and find what their difference follows."""
    columns = term_columns(rows)
    offset = 0.0
    for _ in range(_OFFSET_STEPS):
        base = _base(rows, offset)
        fit = base.with_columns({0: columns[LOAD]}).fit()
        offset += float(fit.values[0])
    base = _base(rows, offset)
    terms, gains = _selected(base, columns)
    regression = _with_terms(base, [columns[term] for term in terms])
    fit = regression.fit()
    coefficients, stds = {}, {}
    for term, column in columns.items():
        own = regression if term in terms else regression.with_columns({0: column})
        found = fit if term in terms else own.fit()
        place = _place(terms, columns, term)
        if term == POSITION or (term == RATE and LOAD not in terms):
            continue
        coefficients[term] = float(found.coefficients[place])
        stds[term] = float(np.sqrt(max(found.coefficient_covariance[place, place], 0.0)))
    shift = float(fit.values[0])
    return TwistFit(
        rows=rows,
        offset=offset + shift,
        offset_std=float(np.sqrt(max(fit.covariance[0, 0], 0.0))),
        terms=tuple(terms),
        coefficients=coefficients,
        stds=stds,
        gains=gains,
        twist=_without_position(terms, columns, fit) + fit.residuals[0],
        residual=fit.residuals[0],
        regression=regression,
        fit=fit,
    )


def term_columns(rows: TwistRows) -> dict[str, FloatArray]:
    """Columns (r, k) of every term that need not be there."""
    columns = {LOAD: rows.load[:, None], DIRECTION: rows.direction[:, None]}
    sides = [float(np.mean(rows.side * sign > 0.0)) for sign in (-1.0, 1.0)]
    if min(sides) >= _LEAST_SIDE:
        columns[SIDE] = rows.side[:, None]
    span = max(float(np.ptp(rows.position)), 1e-12)
    turn = np.pi * (rows.position - rows.position.min()) / span
    orders = np.arange(1, _POSITION_TERMS + 1)
    columns[POSITION] = np.cos(turn[:, None] * orders)
    columns[RATE] = rows.load_rate[:, None]
    return columns


def with_term(found: TwistFit, column: FloatArray) -> Fit:
    """Fit the accepted terms with one more block of columns (r, k)."""
    return found.regression.with_columns({0: column}).fit()


def _base(rows: TwistRows, offset: float) -> Regression:
    """Speed and a constant for each recording."""
    constants = rows.recording[:, None] == np.unique(rows.recording)
    matrix = np.column_stack([rows.speed, constants.astype(float)])
    joint = JointRows(
        matrix=matrix,
        torque=rows.twist(offset),
        columns=np.arange(matrix.shape[1]),
        segments=rows.segments,
    )
    return Regression((joint,), matrix.shape[1])


def _selected(
    base: Regression, columns: Mapping[str, FloatArray]
) -> tuple[list[str], dict[str, float]]:
    """Terms that the likelihood asks for, and what each brings beside those."""
    terms: list[str] = []
    while True:
        gains = _gains(base, columns, terms)
        open_ = [term for term in gains if term not in terms]
        best = max(open_, key=lambda term: gains[term], default=None)
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


def _place(terms: Sequence[str], columns: Mapping[str, FloatArray], term: str) -> int:
    """Where the first coefficient of a term is; behind all others if it is not accepted."""
    before = terms[: terms.index(term)] if term in terms else terms
    return sum(columns[other].shape[1] for other in before)


def _without_position(
    terms: Sequence[str], columns: Mapping[str, FloatArray], fit: Fit
) -> FloatArray:
    """What the accepted terms but the position make of the twist, (r,) rad."""
    part = np.zeros(len(columns[LOAD]))
    for term in terms:
        if term == POSITION:
            continue
        first = _place(terms, columns, term)
        width = columns[term].shape[1]
        part += columns[term] @ fit.coefficients[first : first + width]
    return part


def held_out(found: TwistFit, term: str) -> tuple[float | None, int, int]:
    """Share of the whitened twist's energy that a term takes on blocks that were not fitted.

    Blocks lie at the same places of every recording: its constant is fitted from the others.

    Returns
    -------
    float or None
        None where there are too few rows.
    int, int
        On how many blocks it helps, of how many.
    """
    rows, noise = found.rows, found.fit.noise_models[0]
    place = found.terms.index(term)
    widths = found.regression.widths
    base = found.regression.parameters
    own = slice(base + sum(widths[:place]), base + sum(widths[: place + 1]))
    extended = found.regression.extended[0]
    table = noise.whiten(np.column_stack([extended.matrix, extended.torque]), rows.segments)
    without = np.delete(table, np.r_[own], axis=1)
    count = int(settings.FOLDS)
    block = np.zeros(len(table), dtype=np.int64)
    for number in np.unique(rows.recording):
        places = np.flatnonzero(rows.recording == number)
        block[places] = np.arange(len(places)) * count // len(places)
    energies = np.array(
        [[_predicted(each, block == k) for each in (without, table)] for k in range(count)]
    )
    total = energies.sum(axis=0)
    if total[0] <= 0.0:
        return None, 0, count
    return (
        float(1.0 - total[1] / total[0]),
        int(np.sum(energies[:, 1] < energies[:, 0])),
        count,
    )


def _predicted(table: FloatArray, out: BoolArray) -> float:
    """Energy of what a fit to the other rows of [X y] misses in those that are `out`."""
    solution = np.linalg.lstsq(table[~out, :-1], table[~out, -1], rcond=None)[0]
    return float(np.sum((table[out, -1] - table[out, :-1] @ solution) ** 2))
