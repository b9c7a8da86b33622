"""The simulated motion of every stage, from the given to the extended model."""

from collections.abc import Sequence
from dataclasses import replace

from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import EffectParameter, SimulationGap
from idim_iv_ros.diagnosis.structural.causes import NamedModel, effect_parameters, simulated_effects
from idim_iv_ros.diagnosis.tracking import Tracking, simulated_tracking, simulation_gap
from idim_iv_ros.effects.effect import Place
from idim_iv_ros.types import FloatArray


def tracked_stages(data: Baseline, model: NamedModel, given: FloatArray | None) -> list[Tracking]:
    """Tracking of every stage, in their order.

    Parameters
    ----------
    given
        (b,) base parameters of the nominal model; None where there is none, nor its stage.
    """
    tracked = [] if given is None else [simulated_tracking(data, given)]
    effects: list[tuple[str, Place, dict[str, EffectParameter]]] = []
    for number, fit in enumerate(model.fits):
        if number > 0:
            candidate = model.found[number - 1].candidate
            parameters = effect_parameters(model, number - 1)
            effects.append((candidate.effect.name, candidate.place, parameters))
        simulated = simulated_effects(data, effects)
        tracked.append(simulated_tracking(data, fit.values, simulated))
        if number > 0 and tracked[-1].note and not tracked[-2].note:
            # The stages that follow do without it, rather than without any simulation.
            dropped = effects.pop()[0]
            kept = simulated_tracking(data, fit.values, simulated_effects(data, effects))
            if not kept.note:
                note = f"simulated without {dropped}: {tracked[-1].note}"
                tracked[-1] = replace(kept, caveat=note)
    return tracked


def simulation_gaps(
    model: NamedModel, tracked: Sequence[Tracking], refit: int
) -> list[SimulationGap | None]:
    """Gap of the simulated motion that each effect closes at its joint; `refit`: its stage."""
    return [
        simulation_gap(
            tracked[refit + number], tracked[refit + number + 1], found.candidate.place.joint
        )
        for number, found in enumerate(model.found)
    ]
