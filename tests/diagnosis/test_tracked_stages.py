"""The simulated motion of each stage where an effect cannot be simulated."""

from types import SimpleNamespace
from typing import Any

import pytest

from idim_iv_ros.diagnosis import tracking as module
from idim_iv_ros.diagnosis.tracking import Tracking


def test_effects_that_cannot_be_simulated_do_not_end_the_simulation(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def simulated(data: Any, values: Any, effects: Any = ()) -> Tracking:
        known = "elasticity" not in effects
        return Tracking((), (), (), 1.0, "" if known else "no drive inertia")

    def found(name: str) -> Any:
        effect = SimpleNamespace(name=name)
        return SimpleNamespace(effect=effect, place=None)

    monkeypatch.setattr(module, "simulated_tracking", simulated)
    monkeypatch.setattr(module, "effect_parameters", lambda *_: {})
    monkeypatch.setattr(module, "simulated_effects", lambda _, each: [name for name, *_ in each])
    model: Any = SimpleNamespace(
        effects=(found("elasticity"), found("time_delay")), fits=[SimpleNamespace(values=None)] * 3
    )
    data: Any = None
    refit, stiff, late = module.tracked_stages(data, model, None)
    assert (refit.note, refit.caveat) == ("", "")
    assert stiff.caveat == "simulated without elasticity: no drive inertia"
    assert (stiff.note, late.note) == ("", "")
