"""Recorded less computed commands of one joint, regressed on what changes the control law."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.controller.law_speed import LawSpeed, comparable_rows, limited
from idim_iv_ros.diagnosis.structural.likelihood import Fit, Regression
from idim_iv_ros.effects.controller_mismatch import GROUPS, LAG, ControllerMismatch
from idim_iv_ros.estimation.observation import segments_of
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.signals import Motion
from idim_iv_ros.simulation import ControlLaw
from idim_iv_ros.types import FloatArray


@dataclass(frozen=True)
class CommandRegression:
    """Decimated rows of one joint, without those at the torque limit; (r,) each.

    Attributes
    ----------
    rest : N m (N)
        Recorded less computed command.
    constants : (r, recordings)
        One column for each recording.
    rate : N m/s (N/s)
        Of the computed command.
    acceleration : rad/s² (m/s²)
    size : float
        RMS of the recorded command, N m (N).
    groups : dict
        Torque of a unit of each group that may change.
    noise : dict of str to float
        Share of each group's energy that noise of the encoder makes.
    runs : tuple of slice
        Rows without a gap in time.
    recording : (r,) int
        Which recording each row belongs to.
    time : s
        From the start of the recording.
    step : float
        Time between two samples of the slowest recording, s.
    """

    rest: FloatArray
    constants: FloatArray
    rate: FloatArray
    acceleration: FloatArray
    size: float
    groups: dict[str, FloatArray]
    noise: dict[str, float]
    runs: tuple[slice, ...]
    recording: NDArray[np.int64]
    time: FloatArray
    step: float

    def usable(self, name: str) -> bool:
        """Whether a group varies."""
        return bool(np.std(self.groups[name]) > 1e-12)

    def only(self, kept: NDArray[np.bool_]) -> "CommandRegression":
        """Leave out the rows that are not `kept` (r,)."""
        constants = self.constants[kept]
        return replace(
            self,
            rest=self.rest[kept],
            constants=constants[:, constants.any(axis=0)],
            rate=self.rate[kept],
            acceleration=self.acceleration[kept],
            groups={name: torque[kept] for name, torque in self.groups.items()},
            runs=segments_of([kept[run] for run in self.runs]),
            recording=self.recording[kept],
            time=self.time[kept],
        )

    def fit(self, names: Sequence[str], *, with_lag: bool) -> Fit:
        """Fit constants, groups and, where it is asked for, a lag of the command."""
        parts = [self.constants]
        if with_lag:
            parts.append(-self.rate[:, None])
        matrix = np.column_stack([*parts, *(self.groups[name] for name in names)])
        joint = JointRows(matrix, self.rest, np.arange(matrix.shape[1]), self.runs)
        return Regression((joint,), matrix.shape[1]).fit()

    def changes(self, fit: Fit, names: Sequence[str]) -> dict[str, tuple[float, float]]:
        """(value, std) of the lag and of each group, from a fit with both."""
        constants = self.constants.shape[1]
        deviations = np.sqrt(np.diag(fit.covariance))
        values = zip(fit.values[constants:], deviations[constants:], strict=True)
        return {
            name: (float(value), float(std))
            for name, (value, std) in zip((LAG, *names), values, strict=True)
        }


def rms(fit: Fit) -> float:
    """Of the residual of a fit, N m (N)."""
    return float(np.sqrt(np.mean(fit.residuals[0] ** 2)))


def command_regression(
    motions: Sequence[Motion], law: ControlLaw, joint: int, speed: LawSpeed
) -> CommandRegression | None:
    """Evaluate the law on the measured motion; None where too few rows are left."""
    effect = ControllerMismatch()
    tables, constants, stretches, times = [], [], [], []
    noise_energy, energy = np.zeros(len(GROUPS)), np.zeros(len(GROUPS))
    for number, motion in enumerate(motions):
        signals = motion.signals
        whole = effect.parts(signals, law, joint, speed.of(signals, joint))
        parts, _ = limited(whole, float(law.torque_limit[joint]), signals.rate)
        rest = signals.torque[:, joint] - parts.command
        groups = [parts.groups[name] for name in GROUPS]
        recorded = signals.torque[:, joint]
        table = np.column_stack([rest, parts.rate, parts.acceleration, recorded, *groups])
        table = motion.decimation.whole(table[motion.span])
        kept = comparable_rows(motion, law, joint)
        tables.append(table[kept])
        constants.append(np.full(int(kept.sum()), number))
        times.append(motion.time[kept])
        stretches.append(kept)
        energy += np.sum(table[kept][:, 4:] ** 2, axis=0)
        noise_energy += np.sum(_noise(motion, law, joint, speed)[kept] ** 2, axis=0)
    table = np.concatenate(tables)
    if len(table) < settings.LEAST_ROWS:
        return None
    which = np.concatenate(constants)
    used = np.unique(which)
    return CommandRegression(
        rest=table[:, 0],
        constants=(which[:, None] == used).astype(float),
        rate=table[:, 1],
        acceleration=table[:, 2],
        size=float(np.sqrt(np.mean(table[:, 3] ** 2))),
        groups={name: table[:, 4 + k] for k, name in enumerate(GROUPS)},
        noise=dict(zip(GROUPS, noise_energy / np.maximum(energy, 1e-300), strict=True)),
        runs=segments_of(stretches),
        recording=which,
        time=np.concatenate(times),
        step=1.0 / min(motion.signals.rate for motion in motions),
    )


def _noise(motion: Motion, law: ControlLaw, joint: int, speed: LawSpeed) -> FloatArray:
    """What white noise of the encoder makes of each group, decimated (m, groups)."""
    signals = motion.signals
    span = motion.span
    deviation = np.std(signals.position[span, joint] - motion.position[span, joint])
    random = np.random.default_rng(0).normal(0.0, 1.0, signals.position.shape) * deviation
    still = np.zeros_like(random)
    alone = replace(
        signals,
        position=random,
        velocity=None,
        position_reference=still,
        velocity_reference=still,
    )
    parts = ControllerMismatch().parts(alone, law, joint, speed.of(alone, joint))
    table = np.column_stack([parts.groups[name] for name in GROUPS])[span]
    return motion.decimation.whole(table)
