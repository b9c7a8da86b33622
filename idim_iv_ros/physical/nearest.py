"""The physically consistent parameters that lie nearest to an estimate.

Estimates of base parameters need not belong to any robot: noise, or an effect that the model lacks,
takes a link's moment of inertia below zero. The nearest set of standard parameters that a robot can
have minimises

    ‖R(Kπ − β̂)‖² + λ Σ_i [tr(J₀ᵢ⁻¹ Jᵢ) − log det J₀ᵢ⁻¹ Jᵢ],    Jᵢ ≽ ε J₀ᵢ;  Ia, Fv, Fc ≥ 0,

with RᵀR the inverse of the covariance of β̂, K the grouping and J₀ the nominal pseudo-inertias
(Sousa and Cortesão 2014; Wensing, Kim, Slotine 2018; Lee, Wensing, Park 2020). λ is small: the
recording decides what it shows, and the divergence from the nominal model the rest.
"""

import time
from collections.abc import Callable, Collection, Sequence
from itertools import pairwise

import numpy as np
from scipy.special import chdtrc

from idim_iv_ros.errors import DataError
from idim_iv_ros.estimation.least_squares import solve_instrumental_variables
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.model import BaseParameters, RobotModel
from idim_iv_ros.model.base_parameters import NON_NEGATIVE
from idim_iv_ros.physical.pseudo_inertia import (
    LEAST_OF_NOMINAL,
    UNITS,
    ConicProblem,
    Coordinates,
    ReferenceLink,
    root_of_information,
)
from idim_iv_ros.physical.result import (
    BaseChange,
    LinkInertia,
    PhysicalParameters,
    Source,
    StandardValue,
    TorqueError,
)
from idim_iv_ros.statistics.hypothesis import HypothesisTest
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

_PARTS = 4
Projection = Callable[[FloatArray], FloatArray]


class Judge:
    """Errors of the torque on all rows, and on quarters that were left out of the fit.

    Quarters are reduced once: R factors of three make the fit, that of the fourth judges it.

    `rows`: of all joints; those with instruments make held-out estimates by them. `parameters`:
    number of base parameters, b. `sigma`: (n_joints,) standard deviations of the residuals.
    """

    def __init__(self, rows: Sequence[JointRows], parameters: int, sigma: FloatArray):
        self._parameters, self._sigma = parameters, sigma
        quarters = []
        for joint in rows:
            ends = np.linspace(0, len(joint.torque), _PARTS + 1).astype(np.int64)
            quarters.append([joint.part(slice(*both)).reduced for both in pairwise(ends)])
        self._parts = list(zip(*quarters, strict=True))

    def __call__(
        self, projection: Projection, estimate: FloatArray, consistent: FloatArray
    ) -> TorqueError:
        """Judge β̂ (b,) and the set that `projection` makes of it (b,)."""
        whole = self._error([estimate] * _PARTS), self._error([consistent] * _PARTS)
        estimates = []
        for left_out in range(_PARTS):
            others = [part for k, part in enumerate(self._parts) if k != left_out]
            rows = [first.joined(more) for first, *more in zip(*others, strict=True)]
            try:
                linear = solve_instrumental_variables(rows, self._parameters, self._sigma)
            except (DataError, np.linalg.LinAlgError):  # a quarter is indispensable
                return TorqueError(*whole, None, None)
            estimates.append(linear.values)
        projected = [projection(values) for values in estimates]
        return TorqueError(*whole, self._error(estimates), self._error(projected))

    def _error(self, estimates: Sequence[FloatArray]) -> float:
        """Relative torque error, %, over all quarters, with an estimate for every quarter."""
        error = torque = 0.0
        for part, values in zip(self._parts, estimates, strict=True):
            for rows, sigma in zip(part, self._sigma, strict=True):
                error += float(np.sum(rows.residual(values) ** 2)) / sigma**2
                torque += float(np.sum(rows.torque**2)) / sigma**2
        return 100.0 * float(np.sqrt(error / torque)) if torque > 0.0 else float("nan")


# λ: a difference of one standard deviation costs 1. A load of a hundred times the moments of a thin
# flange has a divergence of thousands, so that λ must be far smaller than a nominal link of twice
# the size would need: else the divergence outweighs the recording, and a rigid arm is called
# impossible. Below 1e-4 the solver begins to fail.
TIE_BREAKER = 1e-3
_LARGEST_TIE_BREAKER = 0.1
ALPHA = 0.01
_ACTIVE = 1.5  # a bound holds a link back within this factor of it
AT_ZERO = 1e-3  # of its σ: what is nearer to zero is there, but for the solver's tolerance
_INDEPENDENT = 1e-9

TO_INSTALL = "clarabel is not installed: pip install 'idim-iv-ros[physical]'"


def nearest_physical(
    robot: RobotModel,
    base: BaseParameters,
    values: FloatArray,
    covariance: FloatArray,
    judge: Judge | None = None,
    shared: Collection[str] = (),
) -> PhysicalParameters:
    """Find the physically consistent parameters nearest to an estimate.

    - `robot`: its given parameters are the nominal model
    - `covariance`: (b, b), rows of zeros: not shown by the recording
    - `judge`: what judges the torque of both; None: not judged
    - `shared`: friction parameters that are not bounded, because an effect shares them: only the
      sum takes energy

    Raises DataError: the solver found none; ImportError: clarabel is not installed.
    """
    begin = time.perf_counter()
    given = base.layout.vector(robot.given)
    coordinates = Coordinates.of(robot, base, given)
    shown, root = root_of_information(covariance)
    group = base.grouping @ coordinates.to_standard
    nominal = given[coordinates.drives]
    bounded = not_negative(base, coordinates.drives, shared)
    scale = _scales(base, coordinates.drives, nominal, values)

    def solve(estimate: FloatArray) -> FloatArray:
        tie_breaker = TIE_BREAKER
        while True:
            problem = ConicProblem(
                matrix=root @ group[shown],
                right=root @ estimate[shown],
                nominal=nominal,
                scale=scale / np.sqrt(tie_breaker),
                bounded=bounded,
                weights=np.full(len(coordinates.links), tie_breaker),
            )
            try:
                x = problem.solve()
                break
            except DataError:  # a recording almost without noise: λ is below the solver's digits
                if tie_breaker > _LARGEST_TIE_BREAKER / 2.0:
                    raise
                tie_breaker *= 10.0
        drives = x[10 * len(coordinates.links) :]
        drives[bounded & (drives < AT_ZERO * drive_std)] = 0.0
        return x

    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    drive_std = smallest_std(base, coordinates.drives, std)
    x = solve(values)
    standard = coordinates.to_standard @ x
    consistent = base.grouping @ standard
    # The estimate, split as the nominal model splits it: drives and friction keep their place.
    start = coordinates.reference
    start[10 * len(coordinates.links) :] = nominal
    change, *_ = np.linalg.lstsq(group[shown], values[shown] - group[shown] @ start, rcond=None)
    before = coordinates.to_standard @ (start + change)
    links = []
    for joint, link, place in zip(robot.joints, coordinates.links, coordinates.places, strict=True):
        first, second = (
            float(np.linalg.eigvalsh(link.relative(parameters[place]))[0])
            for parameters in (before, standard)
        )
        eigenvalues = tuple(map(float, link.eigenvalues(standard[place])))
        active_link = second < _ACTIVE * LEAST_OF_NOMINAL
        links.append(LinkInertia(joint, first, second, LEAST_OF_NOMINAL, eigenvalues, active_link))
    deviations = _standard_deviations(coordinates, root @ group[shown], x, bounded, scale)
    # Whether the recording shows standard parameters alone, in a sum, or not at all.
    rows = base.grouping[shown]
    vectors = np.linalg.svd(rows / np.linalg.norm(rows, axis=1)[:, None], full_matrices=False)[2]
    alone = 1.0 - np.sum(vectors**2, axis=0) < _INDEPENDENT
    sources: list[Source] = ["recording" if yes else "recording and nominal model" for yes in alone]
    for k in np.flatnonzero(~np.any(rows, axis=0)):
        sources[k] = "nominal model"
    # What a bound holds at zero, of what the recording shows.
    at_zero = (standard == 0.0) & np.any(base.grouping, axis=0)
    zeros = [base.layout.names[k] for k in coordinates.drives[bounded] if at_zero[k]]
    active = (*(link.joint for link in links if link.active), *zeros)
    named = zip(base.layout.names, standard, strict=True)
    below = [name for name, value in named if name in shared and value < 0.0]
    distance = float(np.sum((root @ (consistent - values)[shown]) ** 2))
    test = HypothesisTest(
        null="a rigid robot with friction that only takes energy has made the recording",
        scope="all",
        statistic=distance,
        df=len(shown),
        df_denom=None,
        p_value=float(chdtrc(len(shown), distance)),
        alpha=ALPHA,
    )
    error = None
    if judge is not None:
        onto_base = base.grouping @ coordinates.to_standard
        error = judge(lambda other: onto_base @ solve(other), values, consistent)
    return PhysicalParameters(
        test=test,
        sentence=_sentence(test, active, below),
        parameters=tuple(
            StandardValue(
                parameter.name,
                parameter.unit,
                float(standard[k]),
                float(deviations[k]) if sources[k] == "recording" else None,
                float(given[k]),
                sources[k],
            )
            for k, parameter in enumerate(base.layout.parameters)
        ),
        links=tuple(links),
        base=tuple(
            BaseChange(name, value, error, new, (new - value) / error if error > 0.0 else np.nan)
            for name, value, error, new in zip(
                base.names, values.tolist(), std.tolist(), consistent.tolist(), strict=True
            )
        ),
        active=active,
        shared=tuple(name for name in base.layout.names if name in shared),
        covariance=covariance,
        torque_error=error,
        seconds=time.perf_counter() - begin,
    )


def nearest_body(
    link: ReferenceLink, places: Sequence[int], values: FloatArray, std: FloatArray
) -> FloatArray:
    """Return XX … M (10,) of the body nearest to some of its numbers.

    - `link`: the body that decides what these numbers leave open
    - `places`: (k,), which of XX … M are known
    - `values`, `std`: (k,)

    Raises DataError: the solver found none; ImportError: clarabel is not installed.
    """
    rows, none = link.to_parameters[list(places)], np.zeros(0)
    problem = ConicProblem(
        matrix=rows / std[:, None],
        right=values / std,
        nominal=none,
        scale=none,
        bounded=none.astype(bool),
        weights=np.array([TIE_BREAKER]),
    )
    return np.asarray(link.to_parameters @ problem.solve())


def _scales(
    base: BaseParameters, drives: IntArray, nominal: FloatArray, values: FloatArray
) -> FloatArray:
    """Expected distances (k,) of parameters of drives and friction from the nominal ones.

    Infinite where the recording shows it alone. In a sum it is as large as the nominal one or the
    sum itself: a drive without a given inertia may take all of what it shares with a link.
    """
    scale = np.abs(nominal)
    for k, column in enumerate(drives):
        rows = np.flatnonzero(base.grouping[:, column])
        if len(rows) and all(np.count_nonzero(base.grouping[row]) == 1 for row in rows):
            scale[k] = np.inf
        elif len(rows):
            sums = np.abs(values[rows] / base.grouping[rows, column])
            scale[k] = max(scale[k], float(sums.max()))
    return np.where(scale > 0.0, scale, 1.0)


def _standard_deviations(
    coordinates: Coordinates,
    matrix: FloatArray,
    x: FloatArray,
    bounded: BoolArray,
    scale: FloatArray,
) -> FloatArray:
    """Deviations of π* by the noise of β̂ alone; dπ*/dβ̂ is constant near the optimum."""
    links = len(coordinates.links)
    hessian = 2.0 * matrix.T @ matrix
    for link in range(links):
        places = slice(10 * link, 10 * link + 10)
        turned = np.linalg.inv(np.tensordot(x[places], UNITS, 1)) @ UNITS
        hessian[places, places] += TIE_BREAKER * np.einsum("aij,bji->ab", turned, turned)
    drives = np.arange(len(scale)) + 10 * links
    hessian[drives, drives] += 2.0 * TIE_BREAKER / scale**2
    free = np.ones(len(x), dtype=bool)
    free[10 * links :] = ~(bounded & (x[10 * links :] <= 0.0))
    gain = np.zeros((len(x), len(matrix)))
    gain[free] = np.linalg.solve(hessian[np.ix_(free, free)], 2.0 * matrix[:, free].T)
    return np.asarray(np.linalg.norm(coordinates.to_standard @ gain, axis=1))


def not_negative(base: BaseParameters, drives: IntArray, shared: Collection[str]) -> BoolArray:
    """Whether physics forbids drive or friction parameters (k,) below zero; not `shared` ones."""
    parameters = [base.layout.parameters[k] for k in drives]
    allowed = [one.kind in NON_NEGATIVE and one.name not in shared for one in parameters]
    return np.array(allowed, dtype=bool)


def smallest_std(base: BaseParameters, drives: IntArray, std: FloatArray) -> FloatArray:
    """Smallest σ (k,) of the base parameters in which a drive or friction parameter appears."""
    parts = base.grouping[:, drives] != 0.0
    shown = np.where(parts & (std > 0.0)[:, None], std[:, None], np.inf).min(axis=0)
    return np.where(np.isfinite(shown), shown, 0.0)


def _sentence(test: HypothesisTest, active: Sequence[str], below: Sequence[str]) -> str:
    bounds = f"bounds hold back {', '.join(active)}" if active else "no bound is touched"
    if below:
        bounds += (
            f"; {', '.join(below)} below zero, which an effect of friction at the same joint makes "
            "up for"
        )
    if test.accepted:
        return (
            "A physical robot explains this recording as well as the estimate does, within noise; "
            f"{bounds}."
        )
    return (
        "No rigid robot with friction that only takes energy could have made this recording "
        f"(p = {test.p_value:.2g}, and the test is conservative): the model lacks an effect, or "
        f"the transmission or the effort scale is wrong; {bounds}."
    )
