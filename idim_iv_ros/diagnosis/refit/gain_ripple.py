"""How the gain of efforts measured as currents ripples over the position: no cause.

Slots, poles and the sensors of the phase currents make the torque of a unit current depend on the
rotor's angle. What is recorded is then the torque times 1 + a sin(k q + φ): it looks like a torque
ripple over the position, but grows with the torque, and no robot that is simulated in N m has it.
Where a recording tells the two apart, the ripple of the gain is taken out of the effort.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.likelihood import Fit, Regression
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.types import FloatArray

# rad of phase a rad: of the motor behind a gear, up to six poles behind one of 100.
_LEAST_WAVES, _MOST_WAVES = 50.0, 600.0
_WAVES_TRIED = 6  # likely waves of each joint
_WAVE_STEPS = 7  # wave numbers that are tried near each
_SIDE_LOBES = 15.0  # resolutions to the next likely wave: slow motion covers a part of the range
_LEVEL = 0.01  # probability, times the waves and joints, up to which the gain ripples
_SUPPORT = 6.0  # chi-square beyond the likeliest ripple of the torque, at least: odds of 20
_MOST_RIPPLES = 2  # of a joint's gain that are taken out


@dataclass(frozen=True)
class GainRipple:
    """One wave of the gain of a joint's effort.

    Attributes
    ----------
    joint : int
    wave_number : float
        Waves per rad (m) times 2 π: k in sin(k q).
    size, std : float
        Relative amplitude and its standard deviation.
    """

    joint: int
    wave_number: float
    size: float
    std: float

    def sentence(self, joints: Sequence[str]) -> str:
        """Say it for the notes."""
        half = 100.0 * settings.NORMAL_95 * self.std
        return (
            f"the gain of the effort of {joints[self.joint]} ripples over the position by "
            f"{100.0 * self.size:.2g} ± {half:.1g} %, {self.wave_number:.4g} rad of phase for each "
            "rad of the joint: a property of the measured current, which was taken out"
        )


def without_gain_ripples(
    data: Baseline, regression: Regression
) -> tuple[Baseline, Regression, tuple[GainRipple, ...]]:
    """Take ripples of the gain out of the efforts' rows where these are currents.

    A wave is taken for one of the gain where, after a correction for all that were tried, it is
    significant, and clearly likelier than every wave of the torque itself.

    Parameters
    ----------
    data
    regression
        Of the refit on the smooth motion, with its efforts aligned.
    """
    signals = data.prepared.configuration.signals
    if signals.effort_scale is None and signals.effort_unit == "N m":
        return data, regression, ()
    ripples: list[GainRipple] = []
    for _ in range(_MOST_RIPPLES):
        fit = regression.fit()
        waves = [_wave(_Score(data, fit, joint)) for joint in range(len(data.joints))]
        likely = [wave for wave in waves if wave is not None]
        for ripple, torque in likely:
            rows, joints, joint = list(data.rows), list(regression.joints), ripple.joint
            rows[joint] = replace(rows[joint], torque=rows[joint].torque - torque)
            joints[joint] = replace(joints[joint], torque=rows[joint].torque)
            data = replace(data, rows=tuple(rows))
            regression = replace(regression, joints=tuple(joints))
            ripples.append(ripple)
        if not likely:
            break
    return data, regression, tuple(ripples)


def _wave(score: "_Score") -> tuple[GainRipple, FloatArray] | None:
    """Likeliest ripple of one joint's gain with its torque at the rows (r,), if there is one."""
    gain = max((score.refined(k, True) for k in score.peaks(True)), default=None)
    torque = max((score.refined(k, False) for k in score.peaks(False)), default=None)
    if gain is None or torque is None:
        return None
    statistic, wave_number = gain
    others = [score.refined(k, True)[0] for k in score.peaks(True, other_than=wave_number)]
    if (
        not others
        or statistic < settings.GAIN_RIPPLE_ALONE * max(others)
        or score.tried * chi2.sf(statistic, 2) > _LEVEL
        or statistic < torque[0] + _SUPPORT
    ):
        return None
    columns = score.columns(wave_number, True)
    left = score.left(columns)
    covariance = np.linalg.pinv(left.T @ left)
    values = covariance @ (left.T @ score.white)
    size = float(np.hypot(*values))
    direction = values / max(size, 1e-300)
    std = float(np.sqrt(direction @ covariance @ direction))
    return GainRipple(score.joint, wave_number, size, std), columns @ values


class _Score:
    """What waves over one joint's position would take of its residual."""

    def __init__(self, data: Baseline, fit: Fit, joint: int) -> None:
        self.data, self.joint = data, joint
        self.rows = data.rows[joint]
        self.noise = fit.noise_models[joint]
        self.residual = fit.residuals[joint]
        white = self.noise.standardized(
            np.column_stack([self.residual, self.rows.matrix]), self.rows.segments
        )
        self.white = white[:, 0]
        self.basis, _ = np.linalg.qr(white[:, 1:])
        self.motions = data.motions
        positions = [motion.position[:, joint] for motion in data.motions]
        self.low = min(float(position.min()) for position in positions)
        self.range = max(float(position.max()) for position in positions) - self.low
        self.resolution = 2.0 * np.pi / max(self.range, 1e-9)

    @property
    def tried(self) -> float:
        """Independent waves among which the best was chosen, at all joints."""
        return len(self.data.joints) * max(1.0, _MOST_WAVES / self.resolution)

    def columns(self, wave_number: float, gain: bool) -> FloatArray:
        """Sine and cosine at the rows, (r, 2): times the torque, or in N m (N)."""
        parts = []
        for motion in self.motions:
            phase = wave_number * motion.position[:, self.joint]
            waves = np.column_stack([np.sin(phase), np.cos(phase)])
            # What turns faster than the grid can show averages out in a row.
            shown = wave_number * np.abs(motion.velocity[:, self.joint]) < np.pi * motion.rate
            waves *= shown[:, None]
            if gain:
                waves *= motion.torque[:, [self.joint]]
            parts.append(motion.rows(waves))
        return self.data.counting(self.joint, parts)

    def left(self, columns: FloatArray) -> FloatArray:
        """Whitened columns less what the model absorbs of them."""
        white = self.noise.standardized(columns, self.rows.segments)
        return np.asarray(white - self.basis @ (self.basis.T @ white))

    def statistic(self, wave_number: float, gain: bool) -> float:
        """Chi-square with two degrees of freedom of a wave that is not there."""
        basis, _ = np.linalg.qr(self.left(self.columns(wave_number, gain)))
        return float(np.sum((basis.T @ self.white) ** 2))

    def refined(self, wave_number: float, gain: bool) -> tuple[float, float]:
        """Largest statistic near a wave number, and where."""
        near = wave_number + self.resolution * np.linspace(-0.75, 0.75, _WAVE_STEPS)
        scores = [(self.statistic(float(k), gain), float(k)) for k in near]
        best = max(scores)[1]
        step = 0.5 * float(near[1] - near[0])
        return max([*scores, *((self.statistic(k, gain), k) for k in (best - step, best + step))])

    def peaks(self, gain: bool, other_than: float | None = None) -> list[float]:
        """Wave numbers at which the residual correlates most, by one Fourier transform.

        Those near one are left out: a wave that shows in slow motion alone has side lobes.

        The residual, times the torque for a ripple of the gain, is summed over bins of the
        position; what the filters take of each wave is left to `statistic`.
        """
        width = np.pi / (4.0 * _MOST_WAVES)
        bins = int(self.range / width) + 1
        sums = np.zeros(bins)
        counts = [motion.kept[:, self.joint].sum() for motion in self.motions]
        rows = np.split(self.white, np.cumsum(counts))
        for motion, white in zip(self.motions, rows, strict=False):
            position, kept = motion.position[:, self.joint], motion.kept[:, self.joint]
            residual = np.zeros(len(kept))
            residual[kept] = white
            residual = np.interp(np.arange(len(position)), motion.decimation.kept, residual)
            weight = motion.torque[:, self.joint] if gain else 1.0
            where = np.clip(((position - self.low) / width).astype(int), 0, bins - 1)
            sums += np.bincount(where, residual * weight, bins)
        spectrum = np.abs(np.fft.rfft(sums, 4 * bins)) ** 2
        waves = 2.0 * np.pi * np.arange(len(spectrum)) / (4 * bins * width)
        spectrum[(waves < _LEAST_WAVES) | (waves > _MOST_WAVES)] = 0.0
        if other_than is not None:
            spectrum[np.abs(waves - other_than) < _SIDE_LOBES * self.resolution] = 0.0
        chosen: list[float] = []
        while len(chosen) < _WAVES_TRIED and spectrum.any():
            chosen.append(float(waves[np.argmax(spectrum)]))
            spectrum[np.abs(waves - chosen[-1]) <= self.resolution] = 0.0
        return chosen
