"""What no effect of the catalogue explains: its joint, its family, where it is, and how large."""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.diagnosis import sentences, settings
from idim_iv_ros.diagnosis.answer.explained import Explained, matters
from idim_iv_ros.diagnosis.comparison.model_with_terms import Term
from idim_iv_ros.diagnosis.likelihood import Fit
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.command_rows import events_in
from idim_iv_ros.diagnosis.result import Stage, Unexplained
from idim_iv_ros.diagnosis.where import above_noise
from idim_iv_ros.statistics.residuals import excess_kurtosis

_LEAST_EVENT_ROWS = 200  # from which on events are looked for


def unexplained(data: Baseline, explanation: Explained) -> Unexplained | None:
    """Describe the largest residual outside the catalogue; None where there is none.

    Where a joint's gap is its noise nothing is unexplained, whatever the shape of the noise.
    """
    loud = [
        joint
        for joint, floor in enumerate(explanation.floors)
        if joint not in data.left_out and above_noise(explanation.fit.residuals[joint], floor)
    ]
    outside = [term for term in explanation.outside if matters(term) and term.place.joint in loud]
    largest = max(outside, key=lambda term: term.evidence, default=None)
    if largest is not None:
        joint = largest.place.joint
        # A function that leaves the events takes what follows from them: the law answers.
        both = _events(data, explanation.whole, joint) and _events(data, explanation.fit, joint)
        return both or _described(data, explanation, largest)
    events = [
        event for joint in loud if (event := _events(data, explanation.whole, joint)) is not None
    ]
    return max(events, key=lambda event: event.share, default=None)


def unexplained_residual(
    data: Baseline, explanation: Explained, stages: Sequence[Stage]
) -> list[tuple[int, float, float, float]]:
    """Joints at which the last model misses much: (joint, rms, share of the torque, noise).

    The largest share first. Less than a percent of the torque is not much, however little the
    nominal model misses; nor is what errors take that no base parameters hold, which no stage has.
    """
    first, last = stages[0], stages[-1]
    missed = []
    for joint, (name, floor) in enumerate(zip(data.joints, explanation.floors, strict=True)):
        rest = last.torque_rms[name]
        share = rest / data.torque_sizes[joint]
        much = (
            share > settings.UNEXPLAINED_OF_TORQUE
            or rest > settings.UNEXPLAINED_OF_GAP * first.torque_rms[name]
        )
        noise = floor.sigma
        much = much and share >= settings.LEAST_NONPARAMETRIC and joint not in data.left_out
        left = min(rest, float(np.std(explanation.whole.residuals[joint])))
        if noise is not None and left > settings.UNEXPLAINED_OVER_NOISE * noise and much:
            missed.append((joint, rest, share, noise))
    return sorted(missed, key=lambda joint: -joint[2])


def _described(data: Baseline, explanation: Explained, term: Term) -> Unexplained:
    """A term outside the catalogue, with its share of the energy of the whitened residual."""
    joint = term.place.joint
    noise, segments = explanation.whole.noise_models[joint], data.rows[joint].segments
    before, after = (
        float(np.sum(noise.standardized(fit.residuals[joint], segments) ** 2))
        for fit in (explanation.fit, explanation.whole)
    )
    return Unexplained(
        joint=data.joints[joint],
        family=term.effect.family,
        share=max(1.0 - after / max(before, 1e-300), 0.0),
        where=sentences.nonparametric(data, term),
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
    time = data.counting(joint, [motion.elapsed[motion.decimation.kept] for motion in data.motions])
    first = (int(recording[largest]), float(time[largest]))
    more = [(event.recording, event.begin) for event in events_in(white, recording, time)]
    return Unexplained(
        joint=data.joints[joint],
        family="event",
        share=share,
        where=sentences.events(data, joint, share, first, more),
    )
