"""How far the simulated closed loop is from the recorded motion."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.answer.explained import Explained
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.held_out import gap_of, time_blocks
from idim_iv_ros.diagnosis.result.causes import SimulationGap
from idim_iv_ros.diagnosis.result.document import TrackingSeries
from idim_iv_ros.errors import UsageError
from idim_iv_ros.estimation.instruments import SimulatedLoop
from idim_iv_ros.simulation import SimulatedEffect
from idim_iv_ros.simulation.closed_loop import replay
from idim_iv_ros.statistics.bootstrap import energies, roots
from idim_iv_ros.types import FloatArray


@dataclass(frozen=True)
class Tracking:
    """Simulated motion of one stage."""

    data: Baseline
    # (n_samples, n_joints) of each recording: simulated less measured position on its span, rad
    # (m), through the filter of the measurement; empty where it failed.
    errors: tuple[FloatArray, ...]
    note: str = ""  # why there is none
    caveat: str = ""  # what is missing in it

    @property
    def rms(self) -> dict[str, float] | None:
        """Of each joint, rad (m)."""
        if self.note:
            return None
        rms = roots(self.block_energies.sum(axis=0)).tolist()
        return dict(zip(self.data.joints, rms, strict=True))

    @cached_property
    def block_energies(self) -> FloatArray:
        """Squared errors of each joint over time, and time, in blocks of it: (b, n_joints + 1)."""
        sums = []
        for error, motion in zip(self.errors, self.data.prepared.motions, strict=True):
            rate = motion.signals.rate
            (blocks,) = time_blocks([len(error)], rate)
            sums.append(energies(error, blocks) / rate)
        return np.concatenate(sums)


def simulated_tracking(
    data: Baseline, values: FloatArray, effects: Sequence[SimulatedEffect] = ()
) -> Tracking:
    """Simulate the references of every recording and compare with the measured positions.

    `values`: (b,) base parameters of the stage; `effects`: of the stage, with the parameters of the
    catalogue.
    """
    source = data.sources.sources[0]
    if not isinstance(source, SimulatedLoop):
        reason = " ".join(data.sources.controller) or "the closed loop is not known"
        return Tracking(data, (), f"not simulated: {reason}")
    model, errors = data.prepared.model, []
    dynamics, parts = model.dynamic_parameters(values), data.prepared.session.parts
    for motion, law, part in zip(source.motions, source.laws, parts, strict=True):
        name = motion.signals.name
        try:
            simulated = replay(
                model.robot,
                dynamics,
                law,
                motion,
                effects=effects,
                start_time=part.start,
                accelerations=False,
            )
        except UsageError as error:
            return Tracking(data, (), f"not simulated: {error}")
        if simulated.diverged is not None:
            return Tracking(data, (), f"the simulation diverges: {name}: {simulated.diverged}")
        measured = motion.position[motion.span]
        errors.append(motion.filtered(simulated.position)[motion.span] - measured)
        spread = np.maximum(np.ptp(measured, axis=0), 1e-3)
        lost = np.flatnonzero(np.abs(errors[-1]).max(axis=0) > settings.SIMULATION_LOST * spread)
        if len(lost):
            joint = data.joints[lost[0]]
            return Tracking(data, (), f"{name}: simulated {joint} leaves the motion")
    return Tracking(data, tuple(errors))


def tracking_series(before: Tracking, after: Tracking) -> tuple[TrackingSeries, ...]:
    """Tracking errors, reference less position, of every joint and recording."""
    data, made = before.data, []
    for number, motion in enumerate(data.prepared.motions):
        reference = motion.signals.position_reference
        if reference is None:
            continue
        wanted = reference[motion.span]
        thin = slice(None, None, -(-len(wanted) // settings.MOST_POINTS))
        measured = wanted - motion.position[motion.span]
        simulated = [None if gap.note else measured - gap.errors[number] for gap in (before, after)]
        time = (motion.span.start + np.arange(len(wanted))) / motion.signals.rate
        for joint, name in enumerate(data.joints):
            both = [None if gap is None else gap[thin, joint] for gap in simulated]
            bag, errors = motion.signals.name, measured[thin, joint]
            made.append(TrackingSeries(name, bag, time[thin], errors, *both))
    return tuple(made)


def tracked_stages(explanation: Explained) -> list[Tracking]:
    """Tracking of the nominal model, of the refit, and of that with one effect more each time.

    The effects are as the simulator takes them, with the coefficients beside all others.
    """
    data, given = explanation.data, explanation.data.prepared.given
    tracked = [] if given is None else [simulated_tracking(data, given)]
    tracked.append(simulated_tracking(data, explanation.fits[0].values))
    effects: list[SimulatedEffect] = []
    blocks = explanation.regression.blocks
    parts = zip(explanation.effects, blocks, explanation.fits[1:], strict=True)
    for effect, block, fit in parts:
        term, coefficients = effect.term, explanation.fit.coefficients[block]
        numbers = term.effect.parameters(term.shape, coefficients, np.zeros(len(coefficients)))
        values = {name: parameter.value for name, parameter in numbers.items()}
        joint, other = data.joints[term.place.joint], term.place.other
        second = None if other is None else data.joints[other]
        effects.append(SimulatedEffect(term.effect.name, joint, values, second))
        tracked.append(simulated_tracking(data, fit.values, effects))
        if tracked[-1].note and not tracked[-2].note:
            # The stages that follow do without it, rather than without any simulation.
            dropped = effects.pop()
            kept = simulated_tracking(data, fit.values, effects)
            if not kept.note:
                caveat = f"simulated without {dropped.effect}: {tracked[-1].note}"
                tracked[-1] = replace(kept, caveat=caveat)
    return tracked


def simulation_gaps(
    explanation: Explained, tracked: Sequence[Tracking]
) -> list[SimulationGap | None]:
    """Gap of the simulated motion at the joint of each effect, before and after it."""
    gaps: list[SimulationGap | None] = [None] * len(explanation.effects)
    stages = pairwise(tracked[len(tracked) - len(explanation.fits) :])
    for number, pair in enumerate(stages):
        if not any(stage.note for stage in pair):
            columns = [explanation.effects[number].term.place.joint, -1]
            before, after = (stage.block_energies[:, columns] for stage in pair)
            gaps[number] = SimulationGap(**vars(gap_of(before, after)))
    return gaps
