"""What no effect of the catalogue explains: its joint, its family, where it is, and how large."""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.diagnosis import sentences, settings
from idim_iv_ros.diagnosis.answer.named_model import NamedModel
from idim_iv_ros.diagnosis.likelihood import Fit
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.law_event import events_in
from idim_iv_ros.diagnosis.refit.noise_floor import NoiseFloor
from idim_iv_ros.diagnosis.result import Stage, Unexplained
from idim_iv_ros.diagnosis.structural.candidate import Candidate
from idim_iv_ros.statistics.residuals import excess_kurtosis

_LEAST_EVENT_ROWS = 200  # from which on events are looked for


def unexplained(data: Baseline, model: NamedModel) -> Unexplained | None:
    """Describe the largest residual outside the catalogue; None where there is none."""
    sizes = data.torque_sizes
    large = [
        each
        for each in model.outside
        if each.share_of_torque(sizes) >= settings.LEAST_NONPARAMETRIC
    ]
    if large:
        largest = max(large, key=lambda each: each.gain)
        joint = largest.place.joint
        # A function that leaves the events takes what follows from them: the law answers.
        both = _events(data, model.whole, joint) and _events(data, model.fit, joint)
        return both or _described(data, largest)
    joints = sorted(set(range(len(data.joints))) - data.left_out)
    present = [each for joint in joints if (each := _events(data, model.whole, joint)) is not None]
    return max(present, key=lambda each: each.share, default=None)


def small_nonparametric(data: Baseline, model: NamedModel) -> list[Candidate]:
    """Functions outside the catalogue that are too small to matter."""
    sizes = data.torque_sizes
    return [
        each for each in model.outside if each.share_of_torque(sizes) < settings.LEAST_NONPARAMETRIC
    ]


def unexplained_residual(
    data: Baseline, model: NamedModel, stages: Sequence[Stage], floors: Sequence[NoiseFloor]
) -> list[tuple[int, float, float, float]]:
    """Joints at which the last model misses much: (joint, rms, share of the torque, noise).

    The largest share first. Less than a percent of the torque is not much, however little the
    nominal model misses; nor is what errors take that no base parameters hold, which no stage has.
    """
    first, last = stages[0], stages[-1]
    found = []
    for joint, (name, floor) in enumerate(zip(data.joints, floors, strict=True)):
        rest = last.torque_rms[name]
        share = rest / data.torque_sizes[joint]
        much = (
            share > settings.UNEXPLAINED_OF_TORQUE
            or rest > settings.UNEXPLAINED_OF_GAP * first.torque_rms[name]
        )
        noise = floor.sigma
        much = much and share >= settings.LEAST_NONPARAMETRIC and joint not in data.left_out
        left = min(rest, float(np.std(model.whole.residuals[joint])))
        if noise is not None and left > settings.UNEXPLAINED_OVER_NOISE * noise and much:
            found.append((joint, rest, share, noise))
    return sorted(found, key=lambda each: -each[2])


def _described(data: Baseline, candidate: Candidate) -> Unexplained:
    joint = candidate.place.joint
    share = 1.0 - float(np.exp(-2.0 * candidate.gain / len(data.rows[joint].torque)))
    return Unexplained(
        joint=data.joints[joint],
        family=candidate.effect.family,
        share=share,
        where=sentences.nonparametric(data, candidate),
    )


def _events(data: Baseline, fit: Fit, joint: int) -> Unexplained | None:
    """Short events that do not repeat: the whitened residual has far too many large values."""
    rows = data.rows[joint]
    white = fit.noise_models[joint].standardized(fit.residuals[joint], rows.segments)
    energy = white**2
    total = float(energy.sum())
    if total <= 0.0 or len(white) < _LEAST_EVENT_ROWS:
        return None
    most = np.sort(energy)[-max(1, round(settings.EVENT_SAMPLES * len(energy))) :]
    share = float(most.sum()) / total
    if excess_kurtosis(white) < settings.EVENT_KURTOSIS or share < settings.EVENT_ENERGY:
        return None
    size = float(np.sqrt(share * np.mean(fit.residuals[joint] ** 2)))
    if size < settings.LEAST_NONPARAMETRIC * data.torque_sizes[joint]:
        return None
    largest, recording = int(np.argmax(energy)), data.recordings[joint]
    time = data.counting(joint, [each.elapsed[each.decimation.kept] for each in data.motions])
    first = (int(recording[largest]), float(time[largest]))
    more = [(each.recording, each.begin) for each in events_in(white, recording, time)]
    return Unexplained(
        joint=data.joints[joint],
        family="event",
        share=share,
        where=sentences.events(data, joint, share, first, more),
    )
