"""The torque gap of every stage on data that was not used to fit it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.noise_floor import Repeat
from idim_iv_ros.diagnosis.result.causes import LEAST_ROOM, Gap
from idim_iv_ros.diagnosis.result.document import Stage
from idim_iv_ros.estimation.likelihood import Fit, Regression, white_noise
from idim_iv_ros.estimation.qr import NOT_SHOWN, independent_basis, r_factor, stacked_r_factor
from idim_iv_ros.signals.autoregression import AutoregressiveModel
from idim_iv_ros.statistics.bootstrap import energies, interval, resampled, roots
from idim_iv_ros.types import FloatArray, IntArray

# Weight of the held-out rows in the fit that predicts them: what only they show stays finite.
_FOLD_LEAK = 1e-3
_FEWEST_BLOCKS = 8  # in a short session: they are shorter then


def time_blocks(samples: Sequence[int], rate: float, length: float | None = None) -> list[IntArray]:
    """Number the blocks of time of all `samples` of each recording at a `rate` (Hz), (n,) each.

    Blocks of one recording are equally long: a short last one would count as much as the others
    when blocks are drawn. They last 5 s (or `length`) where the session has eight of them, and in a
    shorter one an eighth of it, at least a second.
    """
    seconds = min(settings.TIME_BLOCK, sum(samples) / rate / _FEWEST_BLOCKS)
    usual = length or max(settings.LEAST_TIME_BLOCK, seconds)
    made, first = [], 0
    for total in samples:
        count = max(round(total / rate / usual), 1)
        made.append(first + np.arange(total) * count // max(total, 1))
        first += count
    return made


def stage_of(name: str, sums: Sequence[FloatArray], joints: Sequence[str]) -> Stage:
    """Stage from the `energies` (b, 2) of each joint, its tracking not yet known."""
    pairs = list(zip(joints, sums, strict=True))
    return Stage(
        name=name,
        torque_rms={joint: float(roots(blocks.sum(axis=0))[0]) for joint, blocks in pairs},
        torque_ci95={joint: interval(roots(resampled(blocks))) for joint, blocks in pairs},
        tracking_rms=None,
        note="",
    )


@dataclass(frozen=True)
class HeldOut:
    """What every stage leaves at rows that its fit did not see."""

    # ``given`` where there is one, ``refit``, one for each effect; their tracking not yet known.
    stages: tuple[Stage, ...]
    sums: tuple[tuple[FloatArray, ...], ...]  # `energies` (b, 2) of each stage and joint
    # Of each effect, beside those before it: the share of the energy of the whitened residual that
    # it takes at the joints whose torque it moves, and in how many folds it helps, of how many.
    gains: tuple[tuple[float, int, int], ...]
    note: str  # how the data were divided

    def gap(self, effect: int, joint: int, floor: float | None) -> Gap:
        """Gap at a joint without and with one of the effects, beside those before it."""
        stage = len(self.stages) - len(self.gains) - 1 + effect
        return gap_of(self.sums[stage][joint], self.sums[stage + 1][joint], floor)

    def helps(self, effect: int, joint: int) -> bool:
        """Whether an effect takes from the whitened residual, and from the gap at a joint."""
        gap = self.gap(effect, joint, None)
        return self.gains[effect][0] > 0.0 and gap.after < gap.before


def gap_of(before: FloatArray, after: FloatArray, floor: float | None = None) -> Gap:
    """Gap of two residuals from their `energies` (b, 2), with the interval of its shrinkage."""
    one, two = (float(roots(sums.sum(axis=0))[0]) for sums in (before, after))
    gap = Gap.between(one, two, floor)
    if gap.shrinkage is None:
        return gap
    first, second = (roots(resampled(sums))[:, 0] for sums in (before, after))
    room = first - (floor or 0.0)
    drawn = ((first - second) / np.where(room > 0.0, room, 1.0))[room > LEAST_ROOM * first]
    return replace(gap, ci95=interval(drawn) if len(drawn) > 20 else None)


def held_out(
    data: Baseline,
    extended: Regression,
    fit: Fit,
    labels: Sequence[str],
    repeats: Sequence[Repeat] = (),
    *,
    interleaved: bool = False,
) -> HeldOut:
    """Predict every fold from the others, for every stage.

    All coefficients are refitted and the shapes of effects stay as found: for the torque gap with
    the weights that make it least, for the whitened residual with the noise models of the full fit.
    The predicted fold counts a thousandth in the fit that predicts it, so that what only this fold
    shows cannot blow up.

    `extended`: with one added block for each effect, in the order in which they were accepted;
    `labels`: of their stages, such as ``+stribeck[joint_1]``; `interleaved`: whether folds take
    turns over the whole session: what changes with time cannot be predicted from another part of
    it.
    """
    (folds, note), blocks = folds_of(data, repeats, interleaved=interleaved), row_blocks(data)
    white = tuple(map(white_noise, extended.joints, fit.residuals))  # for the least torque gap
    plain, whitened = (
        predicted(extended, noise_models, folds) for noise_models in (white, fit.noise_models)
    )
    stages = [
        [rest * noise.sigma for rest, noise in zip(stage, white, strict=True)] for stage in plain
    ]
    names, given = ["refit", *labels], data.prepared.given
    if given is not None:
        names.insert(0, "given")
        stages.insert(0, [rows.residual(given) for rows in extended.joints])
    sums = tuple(tuple(map(energies, stage, blocks)) for stage in stages)
    count, gains = 1 + max(int(fold.max()) for fold in folds), []
    for effect, block in enumerate(extended.added):
        before, after = (
            np.sum([np.bincount(folds[j], stage[j] ** 2, count) for j in sorted(block)], axis=0)
            for stage in whitened[effect : effect + 2]
        )
        present = before > 0.0
        helped = int(np.sum(after[present] < before[present]))
        gains.append((float(1.0 - after.sum() / before.sum()), helped, int(present.sum())))
    return HeldOut(
        stages=tuple(stage_of(*pair, data.joints) for pair in zip(names, sums, strict=True)),
        sums=sums,
        gains=tuple(gains),
        note=note,
    )


def row_blocks(data: Baseline, length: float | None = None) -> tuple[IntArray, ...]:
    """Block of time (r_j,) of every row of every joint; see `time_blocks`."""
    lengths = [len(motion.kept) for motion in data.motions]
    return data.of_joints(time_blocks(lengths, data.row_rate, length))


def folds_of(
    data: Baseline, repeats: Sequence[Repeat], *, interleaved: bool = False
) -> tuple[tuple[IntArray, ...], str]:
    """Fold of every row of every joint, and how they were made, in words.

    Recordings where there are three with different motions (repeats share a fold), else stretches
    of the session; where folds are `interleaved`, shorter stretches that take turns.
    """
    group = np.arange(len(data.motions))
    for repeat in repeats:
        group[group == group[repeat.second]] = group[repeat.first]
    kinds, number = np.unique(group, return_inverse=True)
    if len(kinds) >= 3 and not interleaved:
        folds = tuple(number[recording].astype(np.int64) for recording in data.recordings)
        return folds, f"each of {len(kinds)} recordings is predicted from the others"
    lengths = [len(motion.kept) for motion in data.motions]
    seconds, count = sum(lengths) / data.row_rate, int(settings.FOLDS)
    stretches = max(int(seconds / settings.INTERLEAVED_FOLD), count) if interleaved else count
    fold = np.arange(sum(lengths)) * stretches // sum(lengths) % count
    folds = data.of_joints(np.split(fold, np.cumsum(lengths)[:-1]))
    which, why = f"each of {count} blocks", ""
    if interleaved:
        which = f"every {count}th block"
        why = ", as what changes with time cannot be predicted from another part of the session"
    return folds, f"{which} of {seconds / stretches:.2g} s is predicted from the others{why}"


def predicted(
    extended: Regression,
    noise_models: Sequence[AutoregressiveModel],
    folds: Sequence[IntArray],
) -> list[list[FloatArray]]:
    """For each stage, the residual (r_j,) of each joint, whitened, with fits without its fold.

    The R factor of the rows without a fold is that of the other folds' R factors, and its leading
    columns solve every stage: coefficients of blocks after a stage are zero.
    """
    every, b = extended.extended, extended.parameters
    ends = [b, *(b + block.stop for block in extended.blocks)]
    tables = [
        noise.standardized(np.column_stack([rows.matrix, rows.torque]), rows.segments)
        for rows, noise in zip(every, noise_models, strict=True)
    ]
    factors, places = [], [rows.places for rows in every]
    for number in range(1 + max(int(fold.max()) for fold in folds)):
        inside = [table[fold == number] for table, fold in zip(tables, folds, strict=True)]
        factors.append(stacked_r_factor([*map(r_factor, inside)], places, extended.total + 1))
    stages = [[table[:, -1].copy() for table in tables] for _ in ends]
    leak = np.sqrt(_FOLD_LEAK)
    for number, left_out in enumerate(factors):
        others = [factor for other, factor in enumerate(factors) if other != number]
        factor = r_factor(np.vstack([*others, leak * left_out]))
        basis = independent_basis(factor[:, :-1], tolerance=NOT_SHOWN)
        for stage, end in zip(stages, ends, strict=True):
            solution = basis.leading(end).solve(factor[:, -1], extended.total)
            for rest, rows, table, fold in zip(stage, every, tables, folds, strict=True):
                inside_fold = fold == number
                rest[inside_fold] -= table[inside_fold, :-1] @ solution[rows.columns]
    return stages
