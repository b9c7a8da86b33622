"""What no effect of the catalogue explains: its joint, its family, where it is, and how large."""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.joint_units import unit_at
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.noise_floor import NoiseFloor
from idim_iv_ros.diagnosis.result import Stage, Unexplained
from idim_iv_ros.diagnosis.structural.attribution import Found
from idim_iv_ros.diagnosis.structural.causes import NamedModel
from idim_iv_ros.diagnosis.structural.likelihood import Fit
from idim_iv_ros.diagnosis.structural.nonparametric import Nonparametric


def unexplained(data: Baseline, model: NamedModel) -> Unexplained | None:
    """Describe the strongest of what has no name; None where there is nothing."""
    sizes = data.torque_sizes
    large = [
        each
        for each in model.nameless
        if each.candidate.share_of_torque(sizes) >= settings.LEAST_NONPARAMETRIC
    ]
    if large:
        return _nonparametric(data, max(large, key=lambda each: each.candidate.gain))
    found = [_events(data, model.fit, joint) for joint in range(len(data.joints))]
    present = [each for each in found if each is not None]
    return max(present, key=lambda each: each.share, default=None)


def small_remainders(data: Baseline, model: NamedModel) -> tuple[str, ...]:
    """Say of what has no name, and is too small to matter, what it is and how small."""
    sentences = []
    for each in model.nameless:
        share = each.candidate.share_of_torque(data.torque_sizes)
        if share < settings.LEAST_NONPARAMETRIC:
            where = _nonparametric(data, each).where
            sentences.append(f"{where}: {100.0 * share:.2g} % of its torque, too small to matter")
    return tuple(sentences)


def _nonparametric(data: Baseline, found: Found) -> Unexplained:
    candidate = found.candidate
    joint = candidate.place.joint
    effect = candidate.effect
    assert isinstance(effect, Nonparametric)
    rows = len(data.rows[joint].torque)
    share = 1.0 - float(np.exp(-2.0 * candidate.gain / rows))
    name = data.joints[joint]
    where = f"{name}: a torque that {effect.words}"
    if effect.name == "contact beyond a position":
        side, start = candidate.shape
        where += f", {'above' if side > 0 else 'below'} {start:.3g} {unit_at(data, joint, 'rad')}"
    return Unexplained(joint=name, family=effect.family, share=share, where=where)


def _events(data: Baseline, fit: Fit, joint: int) -> Unexplained | None:
    """Short events that do not repeat: the whitened residual has far too many large values."""
    rows = data.rows[joint]
    white = fit.noise_models[joint].apply(fit.residuals[joint], rows.runs)
    energy = white**2
    total = float(energy.sum())
    if total <= 0.0 or len(white) < settings.EVENT_LEAST_ROWS:
        return None
    kurtosis = float(np.mean(white**4) / np.mean(energy) ** 2) - 3.0
    most = np.sort(energy)[-max(1, round(settings.EVENT_SAMPLES * len(energy))) :]
    share = float(most.sum()) / total
    if kurtosis < settings.EVENT_KURTOSIS or share < settings.EVENT_ENERGY:
        return None
    size = float(np.sqrt(share * np.mean(fit.residuals[joint] ** 2)))
    if size < settings.LEAST_NONPARAMETRIC * data.torque_sizes[joint]:
        return None
    largest = int(np.argmax(energy))
    motion = data.motions[int(data.recordings[joint][largest])]
    time = motion.time[motion.decimation.kept[data.places[joint][largest]]]
    part = data.prepared.session.parts[int(data.recordings[joint][largest])]
    return Unexplained(
        joint=data.joints[joint],
        family="event",
        share=share,
        where=f"{data.joints[joint]}: 1 % of the samples hold {100 * share:.0f} % of the "
        f"residual's energy, the largest in {part.bag} {time - part.start:.1f} s after its start",
    )


def unexplained_joints(
    data: Baseline, stages: Sequence[Stage], floors: Sequence[NoiseFloor]
) -> str:
    """Say in one sentence what the last model still misses, the worst first; empty if nothing."""
    first, last = stages[0], stages[-1]
    worst = []
    for joint, (name, floor) in enumerate(zip(data.joints, floors, strict=True)):
        rest = last.torque_rms[name]
        share = rest / data.torque_sizes[joint]
        much = (
            share > settings.UNEXPLAINED_OF_TORQUE
            or rest > settings.UNEXPLAINED_OF_GAP * first.torque_rms[name]
        )
        if (
            floor.sigma is not None
            and rest > settings.UNEXPLAINED_OVER_NOISE * floor.sigma
            and much
        ):
            unit = unit_at(data, joint, "N m")
            words = f"{rest:.3g} {unit} at {name} ({100 * share:.0f} % of its torque"
            worst.append((share, f"{words}, noise {floor.sigma:.2g} {unit})"))
    if not worst:
        return ""
    listed = ", ".join(words for _, words in sorted(worst, reverse=True))
    return f"Still unexplained: {listed}; do not take the causes for the whole gap there."
