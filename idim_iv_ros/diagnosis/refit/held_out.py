"""The torque gap of every stage on data that was not used to fit it.

Intervals are those of a bootstrap over blocks of time: rows that follow one another are not
independent.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.likelihood import Fit, Regression, white_noise_models
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.noise_floor import NoiseFloor, Repeat, common_floor
from idim_iv_ros.diagnosis.result import Gap, Stage
from idim_iv_ros.estimation.qr import NOT_SHOWN, independent_basis, r_factor, stacked_r_factor
from idim_iv_ros.signals import AutoregressiveModel
from idim_iv_ros.types import FloatArray, IntArray

# Weight of the held-out rows in the fit that predicts them: what only they show stays finite.
_FOLD_LEAK = 1e-3
GUARD_FOLD = -1

_FEWEST_BLOCKS = 8  # in a short session: they are shorter then
_RESAMPLES = 1000  # of the bootstrap
_SEED = 20240


def time_blocks(
    recordings: IntArray, places: IntArray, row_rate: float, length: float | None = None
) -> IntArray:
    """Number the blocks of time of rows (r,): 5 s where the session has eight of them.

    In a shorter session they are shorter, at least a second; in a recording there are at most 20.

    Parameters
    ----------
    recordings, places
        (r,) which recording a row belongs to, and which decimated sample of it the row is.
    row_rate
        Decimated samples per second.
    length
        s, instead.
    """
    blocks = np.zeros(len(places), dtype=np.int64)
    inside = [recordings == recording for recording in np.unique(recordings)]
    lengths = [int(np.ptp(places[rows])) + 1 for rows in inside]
    whole = sum(lengths) / row_rate
    seconds = min(settings.TIME_BLOCK, whole / _FEWEST_BLOCKS)
    usual = (length or max(settings.LEAST_TIME_BLOCK, seconds)) * row_rate
    first = 0
    for rows, total in zip(inside, lengths, strict=True):
        # Equal parts: a short last block would count as much as the others when blocks are drawn.
        count = min(max(round(total / usual), 1), settings.MOST_TIME_BLOCKS)
        place = places[rows] - places[rows].min()
        blocks[rows] = first + np.minimum(place * count // total, count - 1)
        first += count
    return blocks


def block_sums(blocks: IntArray, values: FloatArray) -> FloatArray:
    """Sum of values (r,) in each block that has rows: (b,)."""
    _, number = np.unique(blocks, return_inverse=True)
    return np.asarray(np.bincount(number, weights=values), dtype=float)


def resampled(sums: FloatArray) -> FloatArray:
    """Sums over blocks drawn with replacement: (1000, …) from (b, …).

    The draws are the same for the same number of blocks, so that differences are paired.
    """
    count = len(sums)
    draws = np.random.default_rng(_SEED).multinomial(
        count, np.full(count, 1.0 / count), size=_RESAMPLES
    )
    return np.asarray(np.tensordot(draws.astype(float), sums, axes=1))


def interval(values: FloatArray) -> tuple[float, float]:
    """95 % interval of resampled values (1000,)."""
    low, high = np.quantile(values, [0.025, 0.975])
    return float(low), float(high)


@dataclass(frozen=True)
class HeldOut:
    """Residuals of every stage at rows that its fit did not see.

    Attributes
    ----------
    joints : tuple of str
    names : tuple of str
        Of the stages: ``given`` where there is one, ``refit``, then one for each effect.
    folds : one (r_j,) int array for each joint
        −1 for rows beside a border, which belong to none.
    blocks : one (r_j,) int array for each joint
        Blocks of time for the bootstrap.
    residuals : for each stage one (r_j,) array for each joint
        N m (N).
    whitened : the same, whitened to unit variance
        The stages without ``given``.
    own_joints : for each effect the joints whose torque it moves
    floors : tuple of NoiseFloor
    note : str
        How the data were divided.
    """

    joints: tuple[str, ...]
    names: tuple[str, ...]
    folds: tuple[IntArray, ...]
    blocks: tuple[IntArray, ...]
    residuals: tuple[tuple[FloatArray, ...], ...]
    whitened: tuple[tuple[FloatArray, ...], ...]
    own_joints: tuple[tuple[int, ...], ...]
    floors: tuple[NoiseFloor, ...]
    note: str

    @property
    def refit(self) -> int:
        """Which stage is the refit."""
        return self.names.index("refit")

    @cached_property
    def _energies(self) -> list[list[FloatArray]]:
        """For each stage and joint, the sums of squares and of rows in each block, (b, 2)."""
        made = []
        for stage in self.residuals:
            parts = []
            for residual, fold, block in zip(stage, self.folds, self.blocks, strict=True):
                used = fold != GUARD_FOLD
                squares = block_sums(block[used], residual[used] ** 2)
                rows = block_sums(block[used], np.ones(int(used.sum())))
                parts.append(np.column_stack([squares, rows]))
            made.append(parts)
        return made

    def rms(self, stage: int, joint: int) -> tuple[float, tuple[float, float]]:
        """RMS of one joint and its 95 % interval, N m (N)."""
        sums = self._energies[stage][joint]
        draws = resampled(sums)
        return _root(sums.sum(axis=0)), interval(np.sqrt(draws[:, 0] / draws[:, 1]))

    def stage(self, number: int) -> Stage:
        """One stage, its tracking not yet known."""
        found = [self.rms(number, joint) for joint in range(len(self.joints))]
        return Stage(
            name=self.names[number],
            torque_rms={n: value for n, (value, _) in zip(self.joints, found, strict=True)},
            torque_ci95={n: limits for n, (_, limits) in zip(self.joints, found, strict=True)},
            tracking_rms=None,
            note="",
        )

    def stages(self) -> tuple[Stage, ...]:
        """All stages."""
        return tuple(self.stage(number) for number in range(len(self.names)))

    def gap(self, before: int, after: int, joint: int | None) -> Gap:
        """Gap of two stages at a joint; None: root of the sum of all joints' mean squares."""
        which = list(range(len(self.joints))) if joint is None else [joint]
        first = [self._energies[before][j] for j in which]
        second = [self._energies[after][j] for j in which]
        floor = common_floor([self.floors[j] for j in which])
        one = _root(*(sums.sum(axis=0) for sums in first))
        two = _root(*(sums.sum(axis=0) for sums in second))
        share = float(shrinkage(np.array(one), np.array(two), floor))
        draws = [
            np.sqrt(sum(d[:, 0] / d[:, 1] for d in (resampled(s) for s in stage)))
            for stage in (first, second)
        ]
        drawn = shrinkage(np.asarray(draws[0]), np.asarray(draws[1]), floor)
        drawn = drawn[np.isfinite(drawn)]
        if not np.isfinite(share):
            return Gap(one, two, floor, None, None)
        limits = interval(drawn) if len(drawn) > 20 else None
        return Gap(one, two, floor, share, limits)

    def gain(self, effect: int) -> tuple[float, int, int]:
        """Share of the whitened residual's energy that an effect takes; folds it helps, of all.

        Beside the effects before it, over the joints whose torque it moves.
        """
        joints = self.own_joints[effect]
        count = 1 + max(int(self.folds[j].max()) for j in joints)
        sums = np.zeros((2, count))
        for j in joints:
            used = self.folds[j] != GUARD_FOLD
            for k in range(2):
                rest = self.whitened[effect + k][j][used]
                sums[k] += np.bincount(self.folds[j][used], weights=rest**2, minlength=count)
        before, after = sums
        present = before > 0.0
        positive = int(np.sum(after[present] < before[present]))
        return float(1.0 - after.sum() / before.sum()), positive, int(present.sum())


def shrinkage(before: FloatArray, after: FloatArray, floor: float | None) -> FloatArray:
    """(before − after) / (before − floor); NaN where there was nothing above the floor."""
    least = 0.0 if floor is None else floor
    room = before - least
    return np.asarray(
        np.where(
            room > settings.LEAST_ROOM * before,
            (before - after) / np.where(room > 0, room, 1.0),
            np.nan,
        )
    )


def held_out(
    data: Baseline,
    extended: Regression,
    fit: Fit,
    labels: Sequence[str],
    floors: Sequence[NoiseFloor],
    repeats: Sequence[Repeat] = (),
    given: FloatArray | None = None,
    *,
    interleaved: bool = False,
) -> HeldOut:
    """Predict every fold from the others, for every stage.

    All coefficients are refitted and the shapes of effects stay as found: for the torque gap with
    the weights that make it least, for the whitened residual with the noise models of the full
    fit. The predicted fold counts a thousandth in the fit that predicts it, so that what only
    this fold shows cannot blow up.

    Parameters
    ----------
    extended
        With one added block for each effect, in the order in which they were accepted.
    labels
        Names of the effects' stages, such as ``+stribeck[joint_1]``.
    given
        (b,) of the nominal model; None where there is none.
    interleaved
        Whether folds take turns over the whole session: what changes with time cannot be
        predicted from another part of it.
    """
    folds, note = interleaved_folds(data) if interleaved else folds_of(data, repeats)
    ends = extended.parameters + np.cumsum([0, *extended.widths])
    white = white_noise_models(extended.joints, fit.residuals)
    plain, whitened = (
        _predicted(extended, noise_models, folds, ends)
        for noise_models in (white, fit.noise_models)
    )
    scales = [noise.sigma for noise in white]
    stages = [
        tuple(rest * scale for rest, scale in zip(stage, scales, strict=True)) for stage in plain
    ]
    if given is not None:
        stages.insert(0, tuple(rows.residual(given) for rows in extended.joints))
    return HeldOut(
        joints=data.joints,
        names=(*([] if given is None else ["given"]), "refit", *labels),
        folds=folds,
        blocks=tuple(
            time_blocks(recording, place, data.row_rate)
            for recording, place in zip(data.recordings, data.places, strict=True)
        ),
        residuals=tuple(stages),
        whitened=whitened,
        own_joints=tuple(tuple(sorted(block)) for block in extended.added),
        floors=tuple(floors),
        note=note,
    )


def folds_of(data: Baseline, repeats: Sequence[Repeat]) -> tuple[tuple[IntArray, ...], str]:
    """Fold of every row of every joint, and how they were made, in words.

    Recordings where there are three with different motions (repeats share a fold), else blocks.
    """
    count = len(data.motions)
    group = list(range(count))
    for repeat in repeats:
        old, new = group[repeat.second], group[repeat.first]
        group = [new if each == old else each for each in group]
    _, number = np.unique(group, return_inverse=True)
    if number.max() + 1 >= 3:
        return (
            tuple(number[recording].astype(np.int64) for recording in data.recordings),
            f"each of {number.max() + 1} recordings is predicted from the others",
        )
    seconds = sum(len(motion.kept) for motion in data.motions) / data.row_rate
    blocks = int(np.clip(seconds / settings.TIME_BLOCK, settings.FEWEST_FOLDS, settings.MOST_FOLDS))
    return (
        _blocks_of(data, blocks),
        f"each of {blocks} blocks of {seconds / blocks:.2g} s is predicted from the others",
    )


def interleaved_folds(data: Baseline) -> tuple[tuple[IntArray, ...], str]:
    """Fold of every row of every joint where folds take turns, and how they were made, in words."""
    seconds = sum(len(motion.kept) for motion in data.motions) / data.row_rate
    blocks = max(int(seconds / settings.INTERLEAVED_FOLD), settings.FEWEST_FOLDS)
    folds = tuple(
        np.where(fold == GUARD_FOLD, GUARD_FOLD, fold % settings.FEWEST_FOLDS)
        for fold in _blocks_of(data, blocks)
    )
    return folds, (
        f"every {settings.FEWEST_FOLDS}th block of {seconds / blocks:.2g} s is predicted from "
        "the others, as what changes with time cannot be predicted from another part of the session"
    )


def _blocks_of(data: Baseline, blocks: int) -> tuple[IntArray, ...]:
    """Block of every row of every joint."""
    lengths = [len(motion.kept) for motion in data.motions]
    starts = np.concatenate([[0], np.cumsum(lengths)])
    return tuple(
        _blocks(starts[recording] + place, starts, blocks, settings.FOLD_GUARD * data.row_rate)
        for recording, place in zip(data.recordings, data.places, strict=True)
    )


def _blocks(place: IntArray, starts: IntArray, blocks: int, guard: float) -> IntArray:
    """Equal blocks over all recordings one after the other; none beside a border inside one."""
    length = starts[-1] / blocks
    folds: IntArray = np.minimum((place / length).astype(np.int64), blocks - 1)
    for border in length * np.arange(1, blocks):
        if np.min(np.abs(starts - border)) > guard:
            folds[np.abs(place - border) < guard] = GUARD_FOLD
    return folds


def _predicted(
    extended: Regression,
    noise_models: Sequence[AutoregressiveModel],
    folds: Sequence[IntArray],
    ends: IntArray,
) -> tuple[tuple[FloatArray, ...], ...]:
    """For each stage, the residual (r_j,) of each joint, whitened, with fits without its fold."""
    tables = [
        noise.standardized(np.column_stack([rows.matrix, rows.torque]), rows.segments)
        for rows, noise in zip(extended.extended, noise_models, strict=True)
    ]
    solutions = _solutions(extended, tables, folds, ends)
    stages = []
    for stage in solutions:
        residuals = []
        for rows, table, fold in zip(extended.extended, tables, folds, strict=True):
            residual = table[:, -1].copy()
            for number, solution in enumerate(stage):
                inside = fold == number
                residual[inside] -= table[inside, :-1] @ solution[rows.columns]
            residuals.append(residual)
        stages.append(tuple(residuals))
    return tuple(stages)


def _solutions(
    extended: Regression,
    tables: Sequence[FloatArray],
    folds: Sequence[IntArray],
    ends: IntArray,
) -> list[list[FloatArray]]:
    """For each stage and fold, the coefficients (b + k,) fitted without the fold.

    Those of blocks after the stage are zero. The R factor of the rows without a fold is that of
    the other folds' R factors, and its leading columns solve every stage.
    """
    places = [rows.places for rows in extended.extended]
    factors = []
    for number in range(1 + max(int(fold.max()) for fold in folds)):
        inside = [table[fold == number] for table, fold in zip(tables, folds, strict=True)]
        reduced = [r_factor(rows) for rows in inside]
        factors.append(stacked_r_factor(reduced, places, extended.total + 1))
    solutions: list[list[FloatArray]] = [[] for _ in ends]
    leak = np.sqrt(_FOLD_LEAK)
    for number, own in enumerate(factors):
        others = [factor for other, factor in enumerate(factors) if other != number]
        factor = r_factor(np.vstack([*others, leak * own]))
        basis = independent_basis(factor[:, :-1], tolerance=NOT_SHOWN)
        for stage, end in zip(solutions, ends, strict=True):
            stage.append(basis.leading(int(end)).solve(factor[:, -1], extended.total))
    return solutions


def _root(*totals: FloatArray) -> float:
    """Root of the sum of mean squares."""
    return float(np.sqrt(sum(total[0] / max(total[1], 1.0) for total in totals)))
