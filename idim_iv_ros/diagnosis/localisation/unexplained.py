"""What no effect of the catalogue explains: its joint, its family and where it is."""

import numpy as np

from idim_iv_ros.diagnosis.joint_units import unit_at
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import Unexplained
from idim_iv_ros.diagnosis.structural.attribution import Found
from idim_iv_ros.diagnosis.structural.causes import LEAST_NONPARAMETRIC, NamedModel
from idim_iv_ros.diagnosis.structural.likelihood import Fit
from idim_iv_ros.diagnosis.structural.nonparametric import Nonparametric, StopShape

# Excess kurtosis of the whitened residual, and energy in its largest hundredth, of events.
_KURTOSIS = 4.0
_EVENT_SHARE = 0.12
_LARGEST = 0.01


def unexplained(data: Baseline, model: NamedModel) -> Unexplained | None:
    """Describe the strongest of what has no name; None where there is nothing."""
    sizes = data.torque_sizes
    large = [
        each
        for each in model.nameless
        if each.candidate.share_of_torque(sizes) >= LEAST_NONPARAMETRIC
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
        if share < LEAST_NONPARAMETRIC:
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
    shape = candidate.shape
    if isinstance(shape, StopShape):
        side = "above" if shape.side > 0 else "below"
        where += f", {side} {shape.position:.3g} {unit_at(data, joint, 'rad')}"
    return Unexplained(joint=name, family=effect.family, share=share, where=where)


def _events(data: Baseline, fit: Fit, joint: int) -> Unexplained | None:
    """Short events that do not repeat: the whitened residual has far too many large values."""
    rows = data.rows[joint]
    white = fit.noise_models[joint].apply(fit.residuals[joint], rows.runs)
    energy = white**2
    total = float(energy.sum())
    if total <= 0.0 or len(white) < 200:
        return None
    kurtosis = float(np.mean(white**4) / np.mean(energy) ** 2) - 3.0
    most = np.sort(energy)[-max(1, round(_LARGEST * len(energy))) :]
    share = float(most.sum()) / total
    if kurtosis < _KURTOSIS or share < _EVENT_SHARE:
        return None
    size = float(np.sqrt(share * np.mean(fit.residuals[joint] ** 2)))
    if size < LEAST_NONPARAMETRIC * data.torque_sizes[joint]:
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
