"""The best option beside a model: evidence by blocks of time, size, what physics allows.

A coefficient vector in its own eigenbasis has scores z and information λ. Under a size τ its
variance is τ², and the logarithm of the Bayes factor against a size τ₀ is

Σ ½ [z² (1/a − 1/b) − ln(b/a)],   a = 1 + τ₀² λ,   b = 1 + (τ₀² + τ²) λ,

averaged over what τ may be.
"""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import expit, logsumexp, softmax

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.comparison.candidate import Candidate, Catalogue, Key, Kind
from idim_iv_ros.diagnosis.comparison.curves import NONPARAMETRIC
from idim_iv_ros.diagnosis.comparison.model_with_terms import ModelWithTerms, NominalErrors, Term
from idim_iv_ros.diagnosis.comparison.options import LOG_NOTHING
from idim_iv_ros.effects.registry import STRUCTURAL
from idim_iv_ros.estimation.likelihood import rms
from idim_iv_ros.types import FloatArray, IntArray

# Torque that an effect may have, as a share of the joint's: its size is a mixture over these.
_SIZES = np.array([0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64])
_RIVALS = 12  # effects and places whose scores over blocks of time are looked at
_MOST_BANNED = 4  # places that are passed over because they are not visible
_SAME_SCORE = 0.02  # relative
_MOST_ALIKE = 4  # effects and places of nearly the same score that are compared as a whole
_ROUNDING = 1e-5  # of the largest information of a direction: less is none
# Sizes that are tried of what the model takes in part, over that of the rest of it.
_LARGER = (1.0, 3.0, 10.0, 30.0)
_LOOKED_AT = 400  # options whose evidence is computed first: those with the highest bound


class Comparison:
    """Options beside models of one noise and one size of nominal errors."""

    def __init__(self, catalogue: Catalogue, nominal: NominalErrors) -> None:
        self.catalogue, self.nominal = catalogue, nominal
        self.options = nominal.options
        blocks = nominal.options.ledger.blocks
        numbers = np.concatenate(blocks)
        joints = np.repeat(np.arange(len(blocks)), [len(block) for block in blocks])
        new = (np.diff(numbers, prepend=-1) != 0) | (np.diff(joints, prepend=-1) != 0)
        self._starts = np.flatnonzero(new)  # of the blocks of every joint, in lines of all rows
        count = nominal.options.ledger.block_count
        self._in_block = np.equal.outer(np.arange(count), numbers[new]).astype(float)
        self._best: dict[frozenset[tuple[object, ...]], Term | None] = {}

    def with_terms(self, terms: Sequence[Term]) -> ModelWithTerms:
        """Return the model that has these terms beside the nominal errors."""
        return ModelWithTerms(self.nominal, tuple(terms))

    def best(self, terms: Sequence[Term]) -> Term | None:
        """The option that is likeliest beside terms, present and visible; None if none is."""
        state = frozenset(term.identity for term in terms)
        if state not in self._best:
            self._best[state] = self._visible_one(terms)
        return self._best[state]

    def _visible_one(self, terms: Sequence[Term]) -> Term | None:
        ranking = _Ranking(self, terms, curves=False)
        banned = {term.key for term in terms}
        # Numbers are exact, shapes are not: visible beyond misfit of its own and of the others.
        nothing = np.zeros(len(self.options.ledger.joints))
        shares = [np.minimum(other.whole, 1.0) for other in terms if other.is_effect]
        others = np.max([nothing, *shares], axis=0)
        least = np.maximum(settings.MISFIT, settings.VISIBLE_OF_OTHERS * others)
        for _ in range(_MOST_BANNED):
            term = ranking.first(banned)
            if term is None or np.any(term.visible > least):
                return term
            banned.add(term.key)
        return None

    def other_numbers(self, term: Term, others: Sequence[Term]) -> list[Term]:
        """Other numbers of the nominal model that the effect of a term may have at its place."""
        if term.candidate.kind is not Kind.NUMBER:
            return []
        ranking = _Ranking(self, others, curves=False)
        rows = np.flatnonzero(self.options.key[ranking.order] == self.options.keys.index(term.key))
        allowed = ranking.allowed(())
        return [ranking.term(k, allowed) for k in rows.tolist() if ranking.numbers(k) is not None]

    def curve(self, terms: Sequence[Term], replaced: Sequence[Term] = ()) -> Term | None:
        """The likeliest free curve beside terms; None if nothing is left for one.

        Curves that are another form of one of them, or of effects that are `replaced`, are out: so
        it is with friction over time, position or load, of which the catalogue has one effect each;
        friction over speed may be one of several.
        """
        effects = [term for term in (*terms, *replaced) if term.is_effect]
        forms: set[Key] = set()
        for curve in (curve for curve in NONPARAMETRIC if curve.part):
            kind = curve.part, curve.family
            alike = [effect for effect in STRUCTURAL if (effect.part, effect.family) == kind]
            keys = [term.key for term in effects if alike == [term.effect]]
            forms.update(key._replace(effect=curve.name) for key in keys)
        return _Ranking(self, terms, curves=True).first(forms)

    def objective(self, terms: Sequence[Term]) -> float:
        """Tempered evidence of a whole model less what its terms cost."""
        level = self.with_terms(terms).level / settings.TEMPER
        return level - sum(LOG_NOTHING - term.log_prior for term in terms)

    def weighed(self, term: Term, others: Sequence[Term]) -> Term:
        """A term with the evidence, visible share and dispersion that it has beside others."""
        model = self.with_terms(others)
        inner, score, crossed = model.left_of(term)
        values, vectors = np.linalg.eigh(inner)
        seen = values > _ROUNDING * max(float(values[-1]), 1e-300)
        values, vectors = values[seen], vectors[:, seen]
        z = (vectors.T @ score) / np.sqrt(values)
        unit = vectors @ (z / np.sqrt(values))
        products = self.nominal.products_of(term)
        lines = model.lines_left(term.basis.T @ products.lines(self.nominal), crossed)
        over_blocks, by_rows = self.dispersion(model.white_residual, lines, unit)
        dispersion = max(min(term.dispersion, over_blocks), by_rows)
        plain, sizes = term.unit_columns, self.options.ledger.sizes
        shares = np.zeros((2, 1, len(sizes)))
        for joint, table in products.white.items():
            torque = plain[joint] / (np.sqrt(len(table)) * sizes[joint])
            shares[:, 0, joint] = np.sum(torque**2), np.sum((table @ term.basis) ** 2)
        shares /= np.maximum(shares.sum(axis=2, keepdims=True), 1e-300)
        z, values = z / np.sqrt(dispersion), values / dispersion
        evidence = float(self.beyond_misfit(z[None], values[None], shares[0], shares[1], others)[0])
        left = model.uncovered(products.moved @ term.basis, plain, crossed)
        return replace(
            term,
            evidence=evidence,
            presence=float(expit(evidence + self.options.odds_of_presence(term.key))),
            visible=self.shares(term.candidate, others, plain, left, unit)[1],
            dispersion=dispersion,
        )

    def shares(
        self,
        candidate: Candidate,
        others: Sequence[Term],
        plain: dict[int, FloatArray],
        uncovered: Sequence[FloatArray],
        unit: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Shares of the torque (n_joints,) that an option has, and that counts beside others.

        `plain`, `uncovered`: (r_j, w) columns of unit size as they are, and less what the model
        takes of them; `unit`: (w,) coefficients.
        """
        ledger = self.options.ledger
        whole = ledger.shares(plain, unit)
        visible = np.array([rms(left @ unit) for left in uncovered]) / ledger.sizes
        if candidate.kind is not Kind.EFFECT:
            taken = [joint for term in others if term.is_effect for joint in term.place.joints]
            visible = np.where(np.isin(np.arange(len(whole)), taken), visible, whole)
        return whole, visible

    def beyond_misfit(
        self,
        scores: FloatArray,
        information: FloatArray,
        torque: FloatArray,
        shown: FloatArray,
        terms: Sequence[Term],
    ) -> FloatArray:
        """Logarithm of Bayes factors (k,) against what shapes miss, alone and beside other effects.

        What they miss at one joint says nothing of another. A size is known at each joint with the
        information λⱼ there, at most 1/τ₀ⱼ²; the sum over joints is λ / a.

        `scores`, `information`: (k, w) z and λ; `torque`, `shown`: (k, n_joints) shares of the
        joints in the torque of an option, and in what is known of its size.
        """
        nothing = np.zeros(len(self.options.ledger.joints))
        others = sum((term.visible**2 for term in terms if term.is_effect), nothing)
        misfit = settings.MISFIT**2 + settings.MISFIT_OF_OTHERS**2 * others  # τ₀²
        missed = misfit / np.maximum(torque, 1e-12)
        of_joints = information[:, :, None] * shown[:, None, :]
        shares = shown[:, None, :] / (1.0 + missed[:, None, :] * of_joints)
        return log_bayes_factor(scores, information, 1.0 / np.maximum(shares.sum(axis=2), 1e-300))

    def dispersion(
        self, rest: FloatArray, lines: FloatArray, coefficients: FloatArray
    ) -> tuple[float, float]:
        """Variance of an option's score over blocks of time, over that of the model, and by rows.

        The second is where its torque is (White's estimator): 1 where the noise is as large there
        as elsewhere, more where noise grows with the torque or outliers lie. Both are 1 at least.

        `rest`: (r,) whitened residual of the model, all joints one after the other; `lines`,
        `coefficients`: (w, r), (w,) of the option: whitened columns, less what the model takes.
        """
        left = rest - coefficients.astype(lines.dtype) @ lines
        inner = np.asarray(lines @ lines.T, dtype=float)
        values, vectors = np.linalg.eigh(inner)
        seen = values > _ROUNDING * max(float(values[-1]), 1e-300)
        root = vectors[:, seen] / np.sqrt(values[seen])  # directions of unit energy
        energy = (root.T @ (inner @ coefficients)) ** 2
        weights = energy / max(float(energy.sum()), 1e-300)
        unit = root.T.astype(lines.dtype) @ lines
        sums = self._in_block @ np.add.reduceat(unit * left, self._starts, axis=1).T
        over_blocks = np.sum(sums**2, axis=0) * len(sums) / max(len(sums) - 1, 1)
        by_rows = np.sum((unit * left) ** 2, axis=1)
        return max(1.0, float(weights @ over_blocks)), max(1.0, float(weights @ by_rows))


class _Ranking:
    """Options beside one model, in the order of their evidence."""

    def __init__(self, comparison: Comparison, terms: Sequence[Term], *, curves: bool) -> None:
        self.comparison, self.model, self.curves = comparison, comparison.with_terms(terms), curves
        options, nominal = comparison.options, comparison.nominal
        self.products = self.model.options_left()
        bound = np.empty(len(options.candidate))
        for w, which in options.of_width.items():
            inner, score = self.products[w]
            ridge = (nominal.raw[w] + 1e-12)[:, None, None] * np.eye(w)
            solved = np.linalg.solve(inner + ridge, score[:, :, None])[:, :, 0]
            bound[which] = 0.5 * np.sum(score * solved, axis=1)
        bound[options.is_curve != curves] = -np.inf
        bound += options.log_prior
        order = np.argsort(-bound)[:_LOOKED_AT]
        self.order: IntArray = order[bound[order] > LOG_NOTHING - 3.0]
        self.scores, self.information, self.directions = self._eigen()
        by_option = log_bayes_factor(self.scores, self.information) + options.log_prior[self.order]
        self.dispersion = self._dispersions(by_option)
        by = self.dispersion[:, None]
        scores, information = self.scores / np.sqrt(by), self.information / by
        self.score = log_bayes_factor(scores, information) + options.log_prior[self.order]
        joints = nominal.torque_of_joints[self.order], nominal.information_of_joints[self.order]
        self.capped = comparison.beyond_misfit(scores, information, *joints, terms)

    def _eigen(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Scores z and information λ (k, w) of the options in the order, in eigenbases (k, w, w).

        Of unit size; zero, both, in directions that the model takes.
        """
        options = self.comparison.options
        widths = options.width[self.order]
        shape = len(widths), int(widths.max(initial=1))
        scores, information, directions = (
            np.zeros(shape),
            np.zeros(shape),
            np.zeros((*shape, shape[1])),
        )
        for w in np.unique(widths):
            rows = np.flatnonzero(widths == w)
            places = options.place[self.order[rows]]
            inner, score = self.products[w][0][places], self.products[w][1][places]
            values, vectors = np.linalg.eigh(inner)
            seen = values > self.comparison.nominal.raw[w][places][:, None]
            information[rows, :w] = np.where(seen, values, 0.0)
            along = np.matmul(score[:, None, :], vectors)[:, 0, :]
            scores[rows, :w] = np.where(seen, along / np.sqrt(np.where(seen, values, 1.0)), 0.0)
            directions[rows, :w, :w] = vectors
        return scores, information, directions

    def _seen(self, row: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Scores z, information λ and directions (w, k) of one option, where there is any."""
        w, seen = self.comparison.options.width[self.order[row]], self.information[row] > 0.0
        return self.scores[row, seen], self.information[row, seen], self.directions[row, :w, seen].T

    def _dispersions(self, score: FloatArray) -> FloatArray:
        """Of the options in their order, (k,), from their score without dispersion (k,).

        Over blocks the least of the best options of different effects and places, which the right
        one shows; where it is larger, that by rows of the option's own effect and place.
        """
        comparison, keys = self.comparison, self.comparison.options.key[self.order].tolist()
        rivals: dict[int, int] = {}  # rows of the best options, by effect and place
        for row in np.argsort(-score).tolist():
            if score[row] < LOG_NOTHING - 3.0 or len(rivals) >= _RIVALS:
                break
            rivals.setdefault(keys[row], row)
        dispersions = {}
        for key, row in rivals.items():
            option = int(self.order[row])
            columns, crossed = comparison.nominal.option_lines(option), self.model.crossed(option)
            z, values, vectors = self._seen(row)
            dispersions[key] = comparison.dispersion(
                self.model.white_residual,
                self.model.lines_left(columns, crossed),
                vectors @ (z / np.sqrt(values)),
            )
        least = min((over_blocks for over_blocks, _ in dispersions.values()), default=1.0)
        return np.array([max(least, dispersions.get(key, (1.0, 1.0))[1]) for key in keys])

    def first(self, banned: Collection[Key]) -> Term | None:
        """The best one that is present and that physics allows, of a place that is not banned.

        Scores of the same torque differ as the estimates of its dispersion do: effects and places
        of nearly the best score are compared as a whole, and so are all curves, whose numbers of
        coefficients differ.
        """
        rows = self.allowed(banned)
        of_key: dict[int, int] = {}
        for row in rows:
            if self.curves or self.score[row] >= self._nearly(rows[0]):
                of_key.setdefault(int(self.comparison.options.key[self.order[row]]), row)
        terms = [self.term(row, rows) for row in list(of_key.values())[:_MOST_ALIKE]]
        if len(terms) < 2:
            return terms[0] if terms else None
        others = self.model.terms
        return max(terms, key=lambda term: self.comparison.objective((*others, term)))

    def _nearly(self, row: int) -> float:
        """Score that is nearly that of a row."""
        return float(self.score[row]) - _SAME_SCORE * max(float(self.score[row]), 0.0)

    def allowed(self, banned: Collection[Key]) -> list[int]:
        """Rows that are present, and that physics allows, the best first, as far as they matter."""
        options = self.comparison.options
        parts = {term.candidate.effect.part for term in self.model.terms}
        present = self.capped + options.log_presence[self.order] > LOG_NOTHING
        score = np.where(present, self.score, -np.inf)
        rows: list[int] = []
        least = LOG_NOTHING - 6.0
        for row in np.argsort(-score).tolist():
            if score[row] < least:
                break
            k = int(self.order[row])
            acts_with = options.candidates[options.candidate[k]].effect.acts_with
            alone = acts_with and acts_with not in parts
            if alone or options.keys[options.key[k]] in banned or self.numbers(row) is None:
                continue
            if not rows and not self.curves:
                least = max(least, min(self._nearly(row), float(score[row]) - settings.NEAR))
            rows.append(row)
        return rows

    def numbers(self, row: int) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        """Coefficients of unit size, coefficients and deviations; None where not allowed."""
        comparison, options = self.comparison, self.comparison.options
        k, by = int(self.order[row]), self.dispersion[row]
        z, values, vectors = self._seen(row)
        if not len(z):
            return None
        basis = comparison.nominal.basis[int(options.width[k])][options.place[k]]
        # Drawn to zero by the prior of their sizes.
        weights = softmax(_by_size(z[None] / np.sqrt(by), values[None] / by)[0])
        variance = float(weights @ _SIZES**2) * values / by
        unit = vectors @ (variance / (1.0 + variance) * z / np.sqrt(values))
        coefficients = basis @ unit
        deviations = np.linalg.norm(basis @ (vectors / np.sqrt(values)), axis=1)
        if len(z) < len(unit):
            coefficients, deviations = self._of_likeliest_size(k, float(np.linalg.norm(unit)))
            unit = np.linalg.solve(basis, coefficients)
        deviations = deviations * np.sqrt(by)
        candidate, shape = options.named(k)
        if comparison.catalogue.why_impossible(candidate, shape, coefficients, deviations):
            return None
        return unit, coefficients, deviations

    def _of_likeliest_size(self, option: int, least: float) -> tuple[FloatArray, FloatArray]:
        """Coefficients and deviations (w,) of an option of which the model takes directions.

        `least`: root of the squares of its size along the others; it may be larger along those.
        """
        bare = self._bare(option)
        sizes = least / np.sqrt(bare.width) * np.array(_LARGER)
        terms = [replace(bare, size=float(size)) for size in sizes]
        models = [self.comparison.with_terms((*self.model.terms, term)) for term in terms]
        likeliest = max(models, key=lambda model: model.level)
        here = likeliest.blocks[-1]
        variances = np.diag(likeliest.covariance)[here]
        return likeliest.coefficients[here], np.sqrt(np.maximum(variances, 0.0))

    def _bare(self, option: int) -> Term:
        """Term of an option with its columns, before anything is estimated."""
        nominal = self.comparison.nominal
        candidate, shape = self.comparison.options.named(option)
        basis = nominal.basis[candidate.width][self.comparison.options.place[option]]
        inverse, none = np.linalg.pinv(basis), np.zeros(candidate.width)
        return Term(
            candidate=candidate,
            shape=shape,
            columns={j: table @ inverse for j, table in nominal.columns(option).items()},
            coefficients=none,
            deviations=none,
            basis=basis,
            log_prior=float(self.comparison.options.log_prior[option]),
        )

    def term(self, row: int, allowed: Sequence[int]) -> Term:
        """Term of a row, with those of the `allowed` ones that are as good as its rivals."""
        numbers = self.numbers(row)
        assert numbers is not None
        unit, coefficients, deviations = numbers
        comparison, options, option = self.comparison, self.comparison.options, int(self.order[row])
        bare, crossed = self._bare(option), self.model.crossed(option)
        plain = bare.unit_columns
        left = self.model.uncovered(comparison.nominal.moved(option), plain, crossed)
        whole, visible = comparison.shares(bare.candidate, self.model.terms, plain, left, unit)
        least = self.score[row] - settings.NEAR
        near = [row, *(other for other in allowed if other != row and self.score[other] >= least)]
        keys: dict[Key, float] = {}
        for k, weight in zip(self.order[near], softmax(self.score[near]).tolist(), strict=True):
            key = options.keys[options.key[k]]
            keys[key] = keys.get(key, 0.0) + weight
        evidence = float(self.capped[row])
        return replace(
            bare,
            coefficients=coefficients,
            deviations=deviations,
            size=float(np.linalg.norm(unit) / np.sqrt(bare.width)),
            evidence=evidence,
            presence=float(expit(evidence + options.odds_of_presence(bare.key))),
            whole=whole,
            visible=visible,
            rivals=tuple(sorted(keys.items(), key=lambda pair: -pair[1])),
            dispersion=float(self.dispersion[row]),
        )


def _by_size(
    scores: FloatArray, information: FloatArray, least: FloatArray | None = None
) -> FloatArray:
    """Logarithm of the Bayes factor of each size, (k, sizes), from z, λ and a (k, w) each."""
    least = np.ones_like(information) if least is None else least
    information, least = information[:, None, :], least[:, None, :]
    whole = least + _SIZES[:, None] ** 2 * information
    squares = scores[:, None, :] ** 2
    gains = squares * (1.0 / least - 1.0 / whole) - np.log(whole / least)
    return np.asarray(0.5 * gains.sum(axis=2))


def log_bayes_factor(
    scores: FloatArray, information: FloatArray, least: FloatArray | None = None
) -> FloatArray:
    """The mean over sizes, (k,); `least`: a (k, w), one where shapes miss nothing."""
    of_size = _by_size(scores, information, least)
    return np.asarray(logsumexp(of_size, axis=1) - np.log(len(_SIZES)))
