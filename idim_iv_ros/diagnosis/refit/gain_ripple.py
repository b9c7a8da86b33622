"""How the gain of efforts measured as currents ripples over the position: no cause.

Slots, poles and the sensors of the phase currents make the torque of a unit current depend on the
rotor's angle. What is recorded is then the torque times 1 + a sin(k q + φ): it looks like a torque
ripple over the position, but grows with the torque, and no robot that is simulated in N m has it.
Where a recording tells the two apart, the ripple of the gain is taken out of the effort.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.likelihood import Fit, Regression
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.types import FloatArray

# rad of phase a rad: of the motor behind a gear, up to six poles behind one of 100.
_LEAST_WAVES, _MOST_WAVES = 50.0, 600.0
_WAVES_TRIED = 6  # likely waves of each joint
_WAVE_STEPS = 7  # wave numbers that are tried near each
_SIDE_LOBES = 15.0  # resolutions to the next likely wave: slow motion covers a part of the range
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
    if not measured_as_current(data.prepared.configuration):
        return data, regression, ()
    found: list[GainRipple] = []
    for _ in range(_MOST_RIPPLES):
        fit = regression.fit()
        more = [wave for joint in range(len(data.joints)) for wave in _wave(data, fit, joint)]
        if not more:
            break
        for ripple, change in more:
            rows = list(data.rows)
            torque = rows[ripple.joint].torque - change
            rows[ripple.joint] = replace(rows[ripple.joint], torque=torque)
            data = replace(data, rows=tuple(rows))
            joints = list(regression.joints)
            joints[ripple.joint] = replace(joints[ripple.joint], torque=torque)
            regression = replace(regression, joints=tuple(joints))
            found.append(ripple)
    return data, regression, tuple(found)


def measured_as_current(configuration: Configuration) -> bool:
    """Whether efforts are currents, by the configuration's scale or unit."""
    signals = configuration.signals
    return signals.effort_scale is not None or signals.effort_unit != "N m"


def _wave(data: Baseline, fit: Fit, joint: int) -> Iterator[tuple[GainRipple, FloatArray]]:
    """Yield the likeliest ripple of one joint's gain with its torque at the rows, if there is one.

    The change is (r,) N m (N).
    """
    score = _Score(data, fit, joint)
    gain = max((score.refined(k, True) for k in score.peaks(True)), default=None)
    torque = max((score.refined(k, False) for k in score.peaks(False)), default=None)
    if gain is None or torque is None:
        return
    statistic, wave_number = gain
    others = score.peaks(True, beside=wave_number)
    if not others:
        return
    if statistic < settings.GAIN_RIPPLE_ALONE * max(score.refined(k, True)[0] for k in others):
        return
    if score.tried * chi2.sf(statistic, 2) > settings.GAIN_RIPPLE_LEVEL:
        return
    if statistic < torque[0] + settings.GAIN_RIPPLE_SUPPORT:
        return
    columns, values, covariance = score.fitted(wave_number)
    size = float(np.hypot(*values))
    direction = values / max(size, 1e-300)
    std = float(np.sqrt(direction @ covariance @ direction))
    yield GainRipple(joint, wave_number, size, std), columns @ values


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
        self.positions = [motion.position[:, joint] for motion in data.motions]
        self.low = min(float(position.min()) for position in self.positions)
        self.range = max(float(position.max()) for position in self.positions) - self.low
        self.resolution = 2.0 * np.pi / max(self.range, 1e-9)

    @property
    def tried(self) -> float:
        """Independent waves among which the best was chosen, at all joints."""
        return len(self.data.joints) * max(1.0, _MOST_WAVES / self.resolution)

    def columns(self, wave_number: float, gain: bool) -> FloatArray:
        """Sine and cosine at the rows, (r, 2): times the torque, or in N m (N)."""
        parts = []
        for motion, position in zip(self.data.motions, self.positions, strict=True):
            phase = wave_number * position
            waves = np.column_stack([np.sin(phase), np.cos(phase)])
            # What turns faster than the grid can show averages out in a row.
            shown = wave_number * np.abs(motion.velocity[:, self.joint]) < np.pi * motion.rate
            waves *= shown[:, None]
            if gain:
                waves *= motion.torque[:, [self.joint]]
            parts.append(motion.rows(waves))
        return self.data.counting(self.joint, parts)

    def own(self, columns: FloatArray) -> FloatArray:
        """Whitened columns less what the model absorbs of them."""
        white = self.noise.standardized(columns, self.rows.segments)
        return np.asarray(white - self.basis @ (self.basis.T @ white))

    def statistic(self, wave_number: float, gain: bool) -> float:
        """Chi-square with two degrees of freedom of a wave that is not there."""
        own = self.own(self.columns(wave_number, gain))
        basis, _ = np.linalg.qr(own)
        return float(np.sum((basis.T @ self.white) ** 2))

    def refined(self, wave_number: float, gain: bool) -> tuple[float, float]:
        """Largest statistic near a wave number, and where."""
        near = wave_number + self.resolution * np.linspace(-0.75, 0.75, _WAVE_STEPS)
        scores = [(self.statistic(float(k), gain), float(k)) for k in near]
        best = max(scores)[1]
        step = 0.5 * float(near[1] - near[0])
        return max([*scores, *((self.statistic(k, gain), k) for k in (best - step, best + step))])

    def fitted(self, wave_number: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Columns (r, 2), coefficients (2,) and their covariance."""
        columns = self.columns(wave_number, True)
        own = self.own(columns)
        inverse: FloatArray = np.asarray(np.linalg.pinv(own.T @ own), dtype=np.float64)
        return columns, inverse @ (own.T @ self.white), inverse

    def peaks(self, gain: bool, beside: float | None = None) -> list[float]:
        """Wave numbers at which the residual correlates most, by one Fourier transform.

        Those near `beside` are left out: a wave that shows in slow motion alone has side lobes.

        The residual, times the torque for a ripple of the gain, is summed over bins of the
        position; what the filters take of each wave is left to `statistic`.
        """
        width = np.pi / (4.0 * _MOST_WAVES)
        bins = int(self.range / width) + 1
        sums = np.zeros(bins)
        done = 0
        for motion, position in zip(self.data.motions, self.positions, strict=True):
            kept = motion.kept[:, self.joint]
            residual = np.zeros(len(kept))
            count = int(kept.sum())
            residual[kept] = self.white[done : done + count]
            done += count
            places = motion.decimation.kept
            spread = np.interp(np.arange(len(position)), places, residual)
            weight = motion.torque[:, self.joint] if gain else np.ones(len(position))
            where = np.clip(((position - self.low) / width).astype(int), 0, bins - 1)
            sums += np.bincount(where, spread * weight, bins)
        size = 4 * bins
        spectrum = np.abs(np.fft.rfft(sums, size)) ** 2
        waves = 2.0 * np.pi * np.arange(len(spectrum)) / (size * width)
        spectrum[(waves < _LEAST_WAVES) | (waves > _MOST_WAVES)] = 0.0
        if beside is not None:
            spectrum[np.abs(waves - beside) < _SIDE_LOBES * self.resolution] = 0.0
        chosen: list[float] = []
        for place in np.argsort(spectrum)[::-1]:
            k = float(waves[place])
            if spectrum[place] <= 0.0 or len(chosen) == _WAVES_TRIED:
                break
            if all(abs(k - other) > self.resolution for other in chosen):
                chosen.append(k)
        return chosen
