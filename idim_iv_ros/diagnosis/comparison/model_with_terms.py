"""Every option beside the errors of the nominal numbers and beside the terms of a model.

With δ ~ N(0, S Sᵀ) and X whitened, SᵀXᵀXS = Q Λ Qᵀ and M = S Q (1 + Λ)^−½, a product beside the
errors is aᵀb − (Xᵀa)ᵀ M Mᵀ (Xᵀb). Terms of a model are random effects of a large size and enter
in the same way, so that what they change is of their own low rank.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np

from idim_iv_ros.diagnosis.comparison.candidate import Candidate, Key, Kind
from idim_iv_ros.diagnosis.comparison.options import Whitened
from idim_iv_ros.effects.cause import Parameters
from idim_iv_ros.effects.effect import Effect, Place, Shape
from idim_iv_ros.effects.parametric_effect import ParametricEffect
from idim_iv_ros.types import FloatArray

_LINES_KEPT = 64  # options; a search asks for some forty, again and again
_ROUNDING = 1e-5  # of a direction's energy before the errors are taken out: single precision
_LEAST_SIZE, _WIDER = 0.02, 3.0  # of a term, so that its coefficients are as good as free


@dataclass(frozen=True, eq=False)
class Term:
    """One option in a model, and what is estimated of it.

    `whole`, `visible` (n_joints,): share of the torque that it has, and that counts beside errors
    and other terms; `rivals`: other effects and places with their weights, and its own.
    """

    candidate: Candidate
    shape: Shape
    columns: dict[int, FloatArray]  # (r_j, w) torque of unit coefficients, N m
    coefficients: FloatArray  # (w,)
    deviations: FloatArray  # (w,)
    basis: FloatArray  # (w, w) coefficients of a torque of unit size
    size: float = 0.0  # share of the torque, root of the mean over its joints
    log_prior: float = 0.0  # of this option
    evidence: float = 0.0  # ln of the Bayes factor against misfit, when accepted
    presence: float = 0.0  # posterior probability against nothing, before calibration
    whole: FloatArray = field(default_factory=lambda: np.zeros(0))
    visible: FloatArray = field(default_factory=lambda: np.zeros(0))
    rivals: tuple[tuple[Key, float], ...] = ()
    dispersion: float = 1.0  # variance of its score over blocks of time, over the model's

    @property
    def key(self) -> Key:
        """Effect and place."""
        return self.candidate.key

    @property
    def effect(self) -> Effect:
        """What it is, of a term that is no number of the model."""
        effect = self.candidate.effect
        assert not isinstance(effect, ParametricEffect)
        return effect

    @property
    def place(self) -> Place:
        """Where it acts, of a term that belongs to a joint."""
        assert self.candidate.place is not None
        return self.candidate.place

    @property
    def is_effect(self) -> bool:
        """Whether it is an effect of the catalogue."""
        return self.candidate.kind is Kind.EFFECT

    @property
    def parameters(self) -> Parameters:
        """Numbers that mean something to an engineer, with deviations beside all other errors."""
        effect = self.candidate.effect
        if isinstance(effect, ParametricEffect):
            estimates = self.candidate.estimates(self.coefficients, self.deviations)
            return effect.parameters(estimates)
        return effect.parameters(self.shape, self.coefficients, self.deviations)

    @property
    def width(self) -> int:
        """Number of coefficients."""
        return len(self.coefficients)

    @property
    def unit_columns(self) -> dict[int, FloatArray]:
        """(r_j, w) columns of unit size."""
        return {joint: table @ self.basis for joint, table in self.columns.items()}

    def taken_from(self, gap: Sequence[FloatArray]) -> list[FloatArray]:
        """Return a gap (r_j,) of each joint less the term's torque."""
        return [
            left - self.columns[joint] @ self.coefficients if joint in self.columns else left
            for joint, left in enumerate(gap)
        ]

    @property
    def identity(self) -> tuple[int, Shape]:
        """Candidate and shape."""
        return id(self.candidate), self.shape

    @property
    def prior_root(self) -> FloatArray:
        """(w, w) root of the prior covariance of its coefficients."""
        return self.basis * max(_WIDER * self.size, _LEAST_SIZE)


class NominalErrors:
    """All options beside errors of the nominal numbers: relative sizes of links, of drives."""

    def __init__(self, white: Whitened, errors: tuple[float, float]) -> None:
        self.options, self.white, self.errors = white.options, white, errors
        options, ledger = white.options, white.options.ledger
        inner_torques, normal_torque, shared_torque = options.torques
        sizes = ledger.errors(errors)
        values, vectors = np.linalg.eigh(sizes.T @ white.normal @ sizes)
        values = np.maximum(values, 0.0)
        self.root = (sizes @ vectors) / np.sqrt(1.0 + values)  # M, (b, k)
        right = np.zeros(ledger.parameters)
        for rows, model, gap in zip(ledger.joints, white.model, white.gap, strict=True):
            right[rows.columns] += model.T @ gap
        self.explained = self.root.T @ right
        gaps = {joint: rows[:, None] for joint, rows in enumerate(white.gap)}
        self.gap_lines = self.lines_net_of_errors(gaps, (self.root @ self.explained)[:, None])[0]
        self.level = 0.5 * float(self.explained @ self.explained - np.sum(np.log1p(values)))
        self.projected = white.shared @ self.root  # (p, k)
        score = white.score - self.projected @ self.explained
        self.basis, self.inner, self.score, self.raw = {}, {}, {}, {}
        count = len(options.width), len(ledger.joints)
        self.torque_of_joints, self.information_of_joints = np.zeros(count), np.zeros(count)
        for w, which in options.of_width.items():
            inner_torque = np.sum([torques[w] for torques in inner_torques], axis=0)
            columns = options.columns[w]
            part = self.projected[columns]
            inner = white.inner[w] - np.matmul(part, part.transpose(0, 2, 1))
            moved = (part.reshape(-1, part.shape[2]) @ self.root.T).reshape(*columns.shape, -1)
            twice = moved @ normal_torque - 2.0 * shared_torque[columns]
            change = np.matmul(moved, twice.transpose(0, 2, 1))
            visible = inner_torque + 0.5 * (change + change.transpose(0, 2, 1))
            number = options.is_number[which]
            visible[number] = inner_torque[number]
            basis = unit_basis(visible, np.trace(inner_torque, axis1=1, axis2=2))
            turned = basis.transpose(0, 2, 1)
            self.basis[w] = basis
            self.torque_of_joints[which] = _shares(inner_torques, w, basis)
            self.information_of_joints[which] = _shares(white.by_joint, w, basis)
            self.inner[w] = np.matmul(turned, np.matmul(inner, basis))
            before = np.matmul(turned, np.matmul(white.inner[w], basis))
            self.raw[w] = _ROUNDING * np.trace(before, axis1=1, axis2=2)
            self.score[w] = np.matmul(turned, score[columns][:, :, None])[:, :, 0]
        self._made: dict[tuple[object, ...], _TermProducts] = {}
        self._lines: dict[int, FloatArray] = {}

    def products_of(self, term: Term) -> "_TermProducts":
        """Products of a term with everything, made once."""
        if term.identity not in self._made:
            self._made[term.identity] = _TermProducts(self, term)
        return self._made[term.identity]

    def columns(self, option: int) -> dict[int, FloatArray]:
        """(r_j, w) columns of an option, of unit size."""
        options = self.options
        w, candidate = int(options.width[option]), options.named(option)[0]
        first, basis = int(options.shape[option]) * w, self.basis[w][options.place[option]]
        return {
            joint: lines[first : first + w].T @ basis * (not options.ledger.joints[joint].left_out)
            for joint, lines in candidate.lines.items()
        }

    def moved(self, option: int) -> FloatArray:
        """(b, w) errors of the numbers beside columns of an option, of unit size."""
        w, place = int(self.options.width[option]), self.options.place[option]
        projected = self.projected[self.options.columns[w][place]]
        return np.asarray(self.root @ (projected.T @ self.basis[w][place]))

    def lines_net_of_errors(
        self, columns: Mapping[int, FloatArray], moved: FloatArray
    ) -> FloatArray:
        """Whitened columns (r_j, w) less errors (b, w): (w, r), joints one after the other.

        In single precision: variances are taken of them, by the thousand.
        """
        lines = []
        for joint, rows in enumerate(self.options.ledger.joints):
            rest = -(moved[rows.columns].T @ self.white.model[joint].T)
            if joint in columns:
                rest += columns[joint].T
            lines.append(rest)
        return np.hstack(lines, dtype=np.float32, casting="same_kind")

    def option_lines(self, option: int) -> FloatArray:
        """Whitened columns (w, r) of an option beside the errors; the latest ones are kept."""
        if option not in self._lines:
            if len(self._lines) >= _LINES_KEPT:
                del self._lines[next(iter(self._lines))]
            white = self.white.columns(self.columns(option))
            self._lines[option] = self.lines_net_of_errors(white, self.moved(option))
        return self._lines[option]


def unit_basis(inner: FloatArray, whole: FloatArray) -> FloatArray:
    """Coefficients (…, w, w) of torques of unit size, which are at right angles.

    `inner` (…, w, w): products of columns, shares of the torque squared; `whole` (…): energy of
    which a small part is the least that a direction has.
    """
    energy, directions = np.linalg.eigh(inner)
    w = energy.shape[-1]
    energy = np.maximum(energy, 1e-5 * whole[..., None] / w + 1e-30)
    return np.asarray(directions / np.sqrt(energy * w)[..., None, :])


def _shares(by_joint: Sequence[dict[int, FloatArray]], w: int, basis: FloatArray) -> FloatArray:
    """Shares (m_w, n_joints) of the joints in the energy of options of one width, in a basis."""
    energies = [np.sum(basis * np.matmul(inner[w], basis), axis=(1, 2)) for inner in by_joint]
    energy = np.column_stack(energies)
    return np.asarray(energy / np.maximum(energy.sum(axis=1, keepdims=True), 1e-300))


class _TermProducts:
    """Products of one term with the model and with all options, beside the nominal errors."""

    def __init__(self, nominal: NominalErrors, term: Term) -> None:
        white, ledger = nominal.white, nominal.options.ledger
        self.white = white.columns(term.columns)
        shared = np.zeros((ledger.parameters, term.width))
        gap = np.zeros(term.width)
        for joint, table in self.white.items():
            shared[ledger.joints[joint].columns] += white.model[joint].T @ table
            gap += table.T @ white.gap[joint]
        self.projected = nominal.root.T @ shared
        self.moved = nominal.root @ self.projected
        self.score = gap - self.projected.T @ nominal.explained
        self._crossed: dict[int, FloatArray] = {}
        self._lines: FloatArray | None = None

    def lines(self, nominal: NominalErrors) -> FloatArray:
        """Whitened columns (w, r) beside the errors, joints one after the other."""
        if self._lines is None:
            self._lines = nominal.lines_net_of_errors(self.white, self.moved)
        return self._lines

    def crossed(self, nominal: NominalErrors) -> dict[int, FloatArray]:
        """Products (m_w, w, w') of all options, in coefficients of unit size, with the term."""
        if not self._crossed:
            options = nominal.options
            nothing = [np.zeros((len(rows), len(self.score))) for rows in options.ledger.joints]
            rows = [self.white.get(joint, zeros) for joint, zeros in enumerate(nothing)]
            crossed = options.products(nominal.white.noise, rows)
            crossed -= nominal.projected @ self.projected
            self._crossed = {
                w: np.matmul(nominal.basis[w].transpose(0, 2, 1), crossed[columns])
                for w, columns in options.columns.items()
            }
        return self._crossed

    def between(self, other: "_TermProducts") -> FloatArray:
        """Products (w, w') of two terms beside the nominal errors."""
        inner = -self.projected.T @ other.projected
        for joint in self.white.keys() & other.white.keys():
            inner = inner + self.white[joint].T @ other.white[joint]
        return np.asarray(inner)


@dataclass(frozen=True, eq=False)
class ModelWithTerms:
    """A model: the nominal errors and some terms, their coefficients as good as free."""

    nominal: NominalErrors
    terms: tuple[Term, ...]

    @cached_property
    def _products(self) -> list[_TermProducts]:
        return [self.nominal.products_of(term) for term in self.terms]

    @cached_property
    def blocks(self) -> list[slice]:
        """Which coefficients are those of each term."""
        ends = np.cumsum([0, *(term.width for term in self.terms)]).tolist()
        return [slice(*block) for block in pairwise(ends)]

    @cached_property
    def _solved(self) -> tuple[FloatArray, FloatArray, float]:
        """Root (q, q) of the posterior covariance of the terms, its scores (q,), ln det."""
        q = sum(term.width for term in self.terms)
        inner, prior, score = np.zeros((q, q)), np.zeros((q, q)), np.zeros(q)
        every = list(zip(self.terms, self._products, self.blocks, strict=True))
        for k, (term, one, here) in enumerate(every):
            score[here], prior[here, here] = one.score, term.prior_root
            for _, other, there in every[: k + 1]:
                inner[here, there] = one.between(other)
                inner[there, here] = inner[here, there].T
        values, vectors = np.linalg.eigh(prior.T @ inner @ prior)
        values = np.maximum(values, 0.0)
        root = (prior @ vectors) / np.sqrt(1.0 + values)
        return root, score, float(np.sum(np.log1p(values)))

    @cached_property
    def level(self) -> float:
        """Logarithm of the evidence of the whole model, up to a constant of the noise."""
        root, score, logdet = self._solved
        taken = root.T @ score
        return self.nominal.level + 0.5 * float(taken @ taken) - 0.5 * logdet

    @cached_property
    def coefficients(self) -> FloatArray:
        """(q,) of all terms together."""
        return self._taken(self._solved[1])

    @cached_property
    def covariance(self) -> FloatArray:
        """(q, q) of these, before dispersion."""
        root = self._solved[0]
        return np.asarray(root @ root.T)

    @cached_property
    def errors(self) -> FloatArray:
        """(b,) δ: change of the nominal numbers beside the terms."""
        alone = self.nominal.root @ self.nominal.explained
        return np.asarray(alone + self._moved @ self.coefficients)

    @cached_property
    def _moved(self) -> FloatArray:
        """(b, q) what the nominal numbers change by beside a unit of each term."""
        none = np.zeros((self.nominal.options.ledger.parameters, 0))
        return -np.hstack([none, *(products.moved for products in self._products)])

    def left_of(self, term: Term) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Products (w, w), score (w,) and products (w, q) with the terms of one term more.

        In coefficients of unit size, beside the nominal errors; the first two beside the terms.
        """
        products, basis = self.nominal.products_of(term), term.basis
        inner, score = products.between(products), products.score
        others = [products.between(other) for other in self._products]
        crossed = np.hstack([np.zeros((term.width, 0)), *others])
        root, scores, _ = self._solved
        taken = crossed @ root
        inner = inner - taken @ taken.T
        score = score - taken @ (root.T @ scores)
        return basis.T @ inner @ basis, basis.T @ score, basis.T @ crossed

    def options_left(self) -> dict[int, tuple[FloatArray, FloatArray]]:
        """Products (m_w, w, w) and scores (m_w, w) of the options of each width, unit size."""
        nominal = self.nominal
        made = {}
        root, score, _ = self._solved
        taken = root.T @ score
        for w in nominal.inner:
            crossed = np.zeros((len(nominal.inner[w]), w, len(taken)))
            for products, block in zip(self._products, self.blocks, strict=True):
                part = products.crossed(nominal)[w]
                lines = part.reshape(-1, part.shape[2])
                crossed += (lines @ root[block]).reshape(crossed.shape)
            inner = nominal.inner[w] - np.matmul(crossed, crossed.transpose(0, 2, 1))
            made[w] = inner, nominal.score[w] - crossed @ taken
        return made

    @cached_property
    def residuals(self) -> list[FloatArray]:
        """(r_j,) what the model leaves at each joint, N m (N)."""
        gap, alone = self.nominal.options.ledger.gap, self.nominal.root @ self.nominal.explained
        return self.uncovered(alone, dict(enumerate(gap)), self._solved[1])

    @cached_property
    def white_residual(self) -> FloatArray:
        """(r,) what the model leaves, whitened, all joints one after the other."""
        return self.lines_left(self.nominal.gap_lines, self._solved[1])

    @cached_property
    def _lines(self) -> FloatArray:
        """(q, r) whitened columns of all terms, beside the nominal errors."""
        none = np.zeros((0, len(self.nominal.gap_lines)), dtype=np.float32)
        return np.vstack([none, *(products.lines(self.nominal) for products in self._products)])

    def lines_left(self, lines: FloatArray, crossed: FloatArray) -> FloatArray:
        """Lines (w, r) beside the nominal errors, less terms with products `crossed` (w, q)."""
        return np.asarray(lines - self._taken(crossed).T.astype(np.float32) @ self._lines)

    def _taken(self, crossed: FloatArray) -> FloatArray:
        """(q, w) coefficients of the terms beside columns with products `crossed` (w, q)."""
        root = self._solved[0]
        return np.asarray(root @ (root.T @ crossed.T))

    def uncovered(
        self, moved: FloatArray, columns: Mapping[int, FloatArray], crossed: FloatArray
    ) -> list[FloatArray]:
        """Columns (r_j, w) of an option, or the gap, less what errors and terms take, N m (N).

        `moved`: (b, w) nominal errors beside a unit of each column; `crossed`: (w, q) products with
        the terms beside the nominal errors.
        """
        taken, made = self._taken(crossed), []
        errors = moved + self._moved @ taken
        for joint, rows in enumerate(self.nominal.options.ledger.joints):
            rest = columns.get(joint, 0.0) - rows.matrix @ errors[rows.columns]
            for term, block in zip(self.terms, self.blocks, strict=True):
                if joint in term.columns:
                    rest = rest - term.columns[joint] @ taken[block]
            made.append(rest)
        return made

    def crossed(self, option: int) -> FloatArray:
        """Products (w, q) of one option, in coefficients of unit size, with the terms."""
        options = self.nominal.options
        w, place = int(options.width[option]), int(options.place[option])
        crossed = [products.crossed(self.nominal)[w][place] for products in self._products]
        return np.concatenate([np.zeros((w, 0)), *crossed], axis=1)
