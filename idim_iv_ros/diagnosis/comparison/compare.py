"""The best option beside a model: evidence by blocks of time, size, what physics allows.

A coefficient vector in its own eigenbasis has scores z and information λ. Under a size τ its
variance is τ², and the logarithm of the Bayes factor against a size τ₀ is

Σ ½ [z² (1/a − 1/b) − ln(b/a)],   a = 1 + τ₀² λ,   b = 1 + (τ₀² + τ²) λ,

averaged over what τ may be.
"""

from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from scipy.special import expit, softmax

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.comparison.candidate import Candidate, Catalogue, Key, Kind
from idim_iv_ros.diagnosis.comparison.curves import NONPARAMETRIC, is_form_of
from idim_iv_ros.diagnosis.comparison.model_with_terms import ModelWithTerms, NominalErrors, Term
from idim_iv_ros.diagnosis.likelihood import rms
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
        self.options, self.prior = nominal.options, nominal.options.prior
        blocks = nominal.options.ledger.blocks
        numbers = np.concatenate(blocks)
        joints = np.repeat(np.arange(len(blocks)), [len(block) for block in blocks])
        new = (np.diff(numbers, prepend=-1) != 0) | (np.diff(joints, prepend=-1) != 0)
        self._starts = np.flatnonzero(new)  # of the blocks of every joint, in lines of all rows
        count = nominal.options.ledger.block_count
        self._in_block = np.equal.outer(np.arange(count), numbers[new]).astype(float)
        self._best: dict[frozenset[tuple[object, ...]], Term | None] = {}

    def best(self, terms: Sequence[Term]) -> Term | None:
        """The option that is likeliest beside terms, present and visible; None if none is."""
        state = frozenset(term.identity for term in terms)
        if state not in self._best:
            self._best[state] = self._visible_one(ModelWithTerms(self.nominal, tuple(terms)))
        return self._best[state]

    def other_numbers(self, term: Term, others: Sequence[Term]) -> list[Term]:
        """Other numbers of the nominal model that the effect of a term may have at its place."""
        if term.candidate.kind is not Kind.NUMBER:
            return []
        return _Ranking(self, ModelWithTerms(self.nominal, tuple(others)), curves=False).all_of(
            term.key
        )

    def curve(self, terms: Sequence[Term], replaced: Term | None = None) -> Term | None:
        """The likeliest free curve beside terms; None if nothing is left for one.

        Curves that are another form of one of them, or of an effect that is `replaced`, are out.
        """
        effects = [term for term in terms if term.is_effect]
        forms = {
            term.key._replace(effect=curve.name)
            for term in (effects if replaced is None else [*effects, replaced])
            for curve in NONPARAMETRIC
            if is_form_of(curve, term.effect)
        }
        return _Ranking(self, ModelWithTerms(self.nominal, tuple(terms)), curves=True).first(forms)

    def objective(self, terms: Sequence[Term]) -> float:
        """Tempered evidence of a whole model less what its terms cost."""
        level = ModelWithTerms(self.nominal, tuple(terms)).level / settings.TEMPER
        return level - sum(self.prior.nothing - term.log_prior for term in terms)

    def weighed(self, term: Term, others: Sequence[Term]) -> Term:
        """A term with the evidence, visible share and dispersion that it has beside others."""
        model = ModelWithTerms(self.nominal, tuple(others))
        inner, score, crossed = model.left_of(term)
        values, vectors = np.linalg.eigh(inner)
        seen = values > _ROUNDING * max(float(values[-1]), 1e-300)
        values, vectors = values[seen], vectors[:, seen]
        z = (vectors.T @ score) / np.sqrt(values)
        unit = vectors @ (z / np.sqrt(values))
        products = self.nominal.products_of(term)
        lines = model.lines_left(term.basis.T @ products.lines(self.nominal), crossed)
        ((blocks, by_rows),) = self.dispersions(model.white_residual, [lines], [unit])
        dispersion = max(min(term.dispersion, blocks), by_rows)
        plain, sizes = term.unit_columns, self.options.ledger.sizes
        shares = np.zeros((2, 1, len(sizes)))
        for joint, table in products.white.items():
            torque = plain[joint] / (np.sqrt(len(table)) * sizes[joint])
            shares[:, 0, joint] = np.sum(torque**2), np.sum((table @ term.basis) ** 2)
        shares /= np.maximum(shares.sum(axis=2, keepdims=True), 1e-300)
        evidence = float(
            log_bayes_factor(
                z[None] / np.sqrt(dispersion),
                values[None] / dispersion,
                misfit_of(
                    values[None] / dispersion, shares[0], shares[1], self.misfit(model.terms)
                ),
            )[0]
        )
        odds = evidence + self.prior.odds_of_presence(term.key)
        left = model.uncovered(products.moved @ term.basis, plain, crossed)
        return replace(
            term,
            evidence=evidence,
            presence=float(expit(odds)),
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
        sizes = ledger.sizes
        whole, visible = np.zeros((2, len(sizes)))
        for joint, size in enumerate(sizes):
            if joint in plain:
                whole[joint] = ledger.share(joint, plain[joint] @ unit)
            visible[joint] = rms(uncovered[joint] @ unit) / size
        if candidate.kind is not Kind.EFFECT:
            taken = [joint for term in others if term.is_effect for joint in term.place.joints]
            visible = np.where(np.isin(np.arange(len(sizes)), taken), visible, whole)
        return whole, visible

    def misfit(self, terms: Sequence[Term]) -> FloatArray:
        """τ₀² (n_joints,): what shapes of the catalogue miss, alone and beside other effects."""
        nothing = np.zeros(len(self.options.ledger.joints))
        others = sum((term.visible**2 for term in terms if term.is_effect), nothing)
        return settings.MISFIT**2 + settings.MISFIT_OF_OTHERS**2 * others

    def _visible_one(self, model: ModelWithTerms) -> Term | None:
        ranking = _Ranking(self, model, curves=False)
        banned: set[Key] = {term.key for term in model.terms}
        for _ in range(_MOST_BANNED):
            term = ranking.first(banned)
            if term is None:
                return None
            # Numbers are exact, shapes are not: visible beyond misfit of its own and of the others.
            shares = [np.minimum(other.whole, 1.0) for other in model.terms if other.is_effect]
            others = np.max([np.zeros(len(term.whole)), *shares], axis=0)
            least = np.maximum(settings.MISFIT, settings.VISIBLE_OF_OTHERS * others)
            if np.any(term.visible > least):
                return term
            banned.add(term.key)
        return None

    def dispersions(
        self,
        rest: FloatArray,
        lines: Sequence[FloatArray],
        coefficients: Sequence[FloatArray],
    ) -> list[tuple[float, float]]:
        """Variance of scores of options over blocks of time, over that of the model, and by rows.

        The second is where its torque is (White's estimator): 1 where the noise is as large there
        as elsewhere, more where noise grows with the torque or outliers lie. Both are 1 at least.

        `rest`: (r,) whitened residual of the model, all joints one after the other; `lines`,
        `coefficients`: (w_k, r), (w_k,) of every option: whitened columns, less what the model
        takes of them.
        """
        made = []
        for columns, values in zip(lines, coefficients, strict=True):
            left = rest - values.astype(columns.dtype) @ columns
            root, weights = _directions_of(np.asarray(columns @ columns.T, dtype=float), values)
            unit = root.T.astype(columns.dtype) @ columns
            sums = self._in_block @ np.add.reduceat(unit * left, self._starts, axis=1).T
            over_blocks = np.sum(sums**2, axis=0) * len(sums) / max(len(sums) - 1, 1)
            by_rows = np.sum((unit * left) ** 2, axis=1)
            pair = float(weights @ over_blocks), float(weights @ by_rows)
            made.append((max(1.0, pair[0]), max(1.0, pair[1])))
        return made


class _Ranking:
    """Options beside one model, in the order of their evidence."""

    def __init__(self, comparison: Comparison, model: ModelWithTerms, *, curves: bool) -> None:
        self.comparison, self.model = comparison, model
        self.parts = {term.candidate.effect.part for term in model.terms}
        options, prior = comparison.options, comparison.prior
        self.products = model.options_left()
        bound = np.empty(len(options.candidate))
        for w, which in options.of_width.items():
            inner, score = self.products[w]
            ridge = comparison.nominal.raw[w][:, None, None] * np.eye(w) + 1e-12 * np.eye(w)
            solved = np.linalg.solve(inner + ridge, score[:, :, None])[:, :, 0]
            bound[which] = 0.5 * np.sum(score * solved, axis=1)
        bound[options.is_curve != curves] = -np.inf
        self.bound = bound + prior.log
        order = np.argsort(-self.bound)[:_LOOKED_AT]
        self.order: IntArray = order[self.bound[order] > prior.nothing - 3.0]
        self._along = self._eigen()
        self.dispersion = np.ones(len(self.order))
        self.dispersion = self._dispersions(self._log_bayes())
        self.evidence = self._log_bayes()
        self.score = self.evidence + prior.log[self.order]
        self.capped = self._log_bayes(comparison.misfit(model.terms))

    def _eigen(self) -> tuple[FloatArray, FloatArray]:
        """Scores z and information λ (k, w) of the options in the order, in their eigenbases.

        Of unit size; zero, both, in directions that the model takes.
        """
        options = self.comparison.options
        widths = options.width[self.order]
        scores, information = np.zeros((2, len(widths), int(widths.max(initial=1))))
        for w in np.unique(widths):
            rows = np.flatnonzero(widths == w)
            places = options.place[self.order[rows]]
            inner, score = self.products[w][0][places], self.products[w][1][places]
            values, vectors = np.linalg.eigh(inner)
            seen = values > self.comparison.nominal.raw[w][places][:, None]
            information[rows, :w] = np.where(seen, values, 0.0)
            along = np.matmul(score[:, None, :], vectors)[:, 0, :]
            scores[rows, :w] = np.where(seen, along / np.sqrt(np.where(seen, values, 1.0)), 0.0)
        return scores, information

    def _seen(self, row: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Scores z, information λ and directions (w, k) of one option, where there is any."""
        options, k = self.comparison.options, self.order[row]
        scores, information = self._along
        seen = np.flatnonzero(information[row] > 0.0)
        _, vectors = np.linalg.eigh(self.products[int(options.width[k])][0][options.place[k]])
        return scores[row, seen], information[row, seen], vectors[:, seen]

    def _log_bayes(self, misfit: FloatArray | None = None) -> FloatArray:
        """Of the options in their order, with the present dispersion, (k,).

        `misfit`: (n_joints,) of shapes, see `Comparison.misfit`; None: shapes miss nothing.
        """
        if not len(self.order):
            return np.zeros(0)
        scores, information = self._along
        by = self.dispersion[:, None]
        least = np.ones_like(information)
        if misfit is not None:
            nominal = self.comparison.nominal
            torque = nominal.torque_of_joints[self.order]
            shown = nominal.information_of_joints[self.order]
            least = misfit_of(information / by, torque, shown, misfit)
        return log_bayes_factor(scores / np.sqrt(by), information / by, least)

    def _dispersions(self, evidence: FloatArray) -> FloatArray:
        """Of the options in their order, (k,).

        Over blocks the least of the best options of different effects and places, which the right
        one shows; where it is larger, that by rows of the option's own effect and place.
        """
        options, prior = self.comparison.options, self.comparison.prior
        score = evidence + prior.log[self.order]
        rivals: dict[int, int] = {}  # rows of the best options, by effect and place
        for row in np.argsort(-score):
            if score[row] < prior.nothing - 3.0 or len(rivals) >= _RIVALS:
                break
            rivals.setdefault(int(options.key[self.order[row]]), int(row))
        if not rivals:
            return np.ones(len(self.order))
        directions = [self._seen(row) for row in rivals.values()]
        dispersions = self.comparison.dispersions(
            self.model.white_residual,
            [self.model.option_left(int(self.order[row])) for row in rivals.values()],
            [vectors @ (z / np.sqrt(values)) for z, values, vectors in directions],
        )
        least = min(blocks for blocks, _ in dispersions)
        local = {
            key: max(least, by_rows) for key, (_, by_rows) in zip(rivals, dispersions, strict=True)
        }
        return np.array([local.get(int(options.key[k]), least) for k in self.order])

    @cached_property
    def _shrunk(self) -> FloatArray:
        """Factors (k, w), 0 to 1, by which the prior of their sizes draws scores to zero."""
        scores, information = self._along
        by = self.dispersion[:, None]
        information = information / by
        logs = _by_size(scores / np.sqrt(by), information, np.ones_like(information))
        weights = np.exp(logs - logs.max(axis=1, keepdims=True))
        variance = (weights @ _SIZES**2 / weights.sum(axis=1))[:, None] * information
        return np.asarray(variance / (1.0 + variance))

    def first(self, banned: Collection[Key]) -> Term | None:
        """The best one that is present and that physics allows, of a place that is not banned.

        Scores of the same torque differ as the estimates of its dispersion do: effects and places
        of nearly the best score are compared as a whole.
        """
        rows = self._allowed(banned)
        of_key: dict[int, int] = {}
        for row in rows:
            if self.score[row] >= self._nearly(rows[0]):
                of_key.setdefault(int(self.comparison.options.key[self.order[row]]), row)
        terms = [self._with_rivals(row, rows) for row in list(of_key.values())[:_MOST_ALIKE]]
        if len(terms) < 2:
            return terms[0] if terms else None
        others = self.model.terms
        return max(terms, key=lambda term: self.comparison.objective((*others, term)))

    def all_of(self, key: Key) -> list[Term]:
        """Terms of all options of one effect and place that physics allows."""
        options, allowed = self.comparison.options, self._allowed(())
        rows = np.flatnonzero(options.key[self.order] == options.keys.index(key)).tolist()
        return [self._with_rivals(row, allowed) for row in rows if self._numbers(row) is not None]

    def _nearly(self, row: int) -> float:
        """Score that is nearly that of a row."""
        return float(self.score[row]) - _SAME_SCORE * max(float(self.score[row]), 0.0)

    def _allowed(self, banned: Collection[Key]) -> list[int]:
        """Rows that are present, and that physics allows, the best first, as far as they matter."""
        options, prior = self.comparison.options, self.comparison.prior
        present = self.capped + prior.of_presence[self.order] > prior.nothing
        score = np.where(present, self.score, -np.inf)
        rows: list[int] = []
        least = prior.nothing - 6.0
        for row in np.argsort(-score).tolist():
            if score[row] < least:
                break
            k = int(self.order[row])
            acts_with = options.candidates[options.candidate[k]].effect.acts_with
            alone = acts_with and acts_with not in self.parts
            if alone or options.keys[options.key[k]] in banned or self._numbers(row) is None:
                continue
            if not rows:
                least = max(least, min(self._nearly(row), float(score[row]) - settings.NEAR))
            rows.append(row)
        return rows

    def _with_rivals(self, row: int, allowed: Sequence[int]) -> Term:
        """Term of a row, with those of the `allowed` ones that are as good as its rivals."""
        numbers = self._numbers(row)
        assert numbers is not None
        least = self.score[row] - settings.NEAR
        near = [other for other in allowed if other != row and self.score[other] >= least]
        return self._term([row, *near], *numbers)

    def _numbers(self, row: int) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        """Coefficients of unit size, coefficients and deviations; None where not allowed."""
        comparison, options = self.comparison, self.comparison.options
        k = int(self.order[row])
        z, values, vectors = self._seen(row)
        if not len(z):
            return None
        w, place = int(options.width[k]), options.place[k]
        basis = comparison.nominal.basis[w][place]
        unit = vectors @ (self._shrunk[row, self._along[1][row] > 0.0] * z / np.sqrt(values))
        coefficients = basis @ unit
        deviations = np.linalg.norm(basis @ (vectors / np.sqrt(values)), axis=1)
        if len(z) < w:
            coefficients, deviations = self._of_likeliest_size(k, float(np.linalg.norm(unit)))
            unit = np.linalg.solve(basis, coefficients)
        deviations = deviations * np.sqrt(self.dispersion[row])
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
        models = [
            ModelWithTerms(self.comparison.nominal, (*self.model.terms, term)) for term in terms
        ]
        likeliest = max(models, key=lambda model: model.level)
        here = likeliest.blocks[-1]
        variances = np.diag(likeliest.covariance)[here]
        return likeliest.coefficients[here], np.sqrt(np.maximum(variances, 0.0))

    def _bare(self, option: int) -> Term:
        """Term of an option with its columns, before anything is estimated."""
        nominal = self.comparison.nominal
        candidate, shape = self.comparison.options.named(option)
        w, place = candidate.width, self.comparison.options.place[option]
        basis = nominal.basis[w][place]
        inverse, none = np.linalg.pinv(basis), np.zeros(w)
        return Term(
            candidate=candidate,
            shape=shape,
            columns={j: table @ inverse for j, table in nominal.columns(option).items()},
            coefficients=none,
            deviations=none,
            basis=basis,
            log_prior=float(self.comparison.prior.log[option]),
        )

    def _term(
        self,
        kept: Sequence[int],
        unit: FloatArray,
        coefficients: FloatArray,
        deviations: FloatArray,
    ) -> Term:
        """The first of the rows that are `kept`, with the others of them as its rivals."""
        comparison, options, row = self.comparison, self.comparison.options, kept[0]
        prior, nominal, option = comparison.prior, comparison.nominal, int(self.order[row])
        bare = self._bare(option)
        plain = bare.unit_columns
        left = self.model.uncovered(nominal.moved(option), plain, self.model.crossed(option))
        whole, visible = comparison.shares(bare.candidate, self.model.terms, plain, left, unit)
        keys: dict[Key, float] = {}
        weights = softmax(self.score[list(kept)]).tolist()
        for k, weight in zip(self.order[list(kept)], weights, strict=True):
            key = options.keys[options.key[k]]
            keys[key] = keys.get(key, 0.0) + weight
        odds = float(self.capped[row]) + prior.odds_of_presence(bare.key)
        return replace(
            bare,
            coefficients=coefficients,
            deviations=deviations,
            size=float(np.linalg.norm(unit) / np.sqrt(bare.width)),
            evidence=float(self.capped[row]),
            presence=float(expit(odds)),
            whole=whole,
            visible=visible,
            rivals=tuple(sorted(keys.items(), key=lambda pair: -pair[1])),
            dispersion=float(self.dispersion[row]),
        )


def _directions_of(inner: FloatArray, coefficients: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Directions (w, k) of unit energy of an option, and their shares (k,) of its torque."""
    values, vectors = np.linalg.eigh(inner)
    seen = values > _ROUNDING * max(float(values[-1]), 1e-300)
    root = vectors[:, seen] / np.sqrt(values[seen])
    energy = (root.T @ (inner @ coefficients)) ** 2
    return root, energy / max(float(energy.sum()), 1e-300)


def misfit_of(
    information: FloatArray, torque: FloatArray, shown: FloatArray, misfit: FloatArray
) -> FloatArray:
    """Return a = 1 + τ₀² λ (k, w): what shapes miss at one joint says nothing of another.

    A size is known at each joint with the information λⱼ there, at most 1/τ₀ⱼ²; the sum over joints
    is λ / a.

    `information`: (k, w) λ; `torque`, `shown`: (k, n_joints) shares of the joints in the torque of
    an option, and in what is known of its size; `misfit`: (n_joints,) squares of shares of torque.
    """
    of_joints = information[:, :, None] * shown[:, None, :]
    missed = misfit / np.maximum(torque, 1e-12)
    shares = shown[:, None, :] / (1.0 + missed[:, None, :] * of_joints)
    return np.asarray(1.0 / np.maximum(shares.sum(axis=2), 1e-300))


def _by_size(scores: FloatArray, information: FloatArray, least: FloatArray) -> FloatArray:
    """Logarithm of the Bayes factor of each size, (k, sizes), from z, λ and a (k, w) each."""
    information, least = information[:, None, :], least[:, None, :]
    whole = least + _SIZES[:, None] ** 2 * information
    squares = scores[:, None, :] ** 2
    gains = squares * (1.0 / least - 1.0 / whole) - np.log(whole / least)
    return np.asarray(0.5 * gains.sum(axis=2))


def log_bayes_factor(scores: FloatArray, information: FloatArray, least: FloatArray) -> FloatArray:
    """The mean over sizes, (k,)."""
    of_size = _by_size(scores, information, least)
    top = of_size.max(axis=1)
    return np.asarray(top + np.log(np.mean(np.exp(of_size - top[:, None]), axis=1)))
