"""Which effects are kept, from what they do on data that was not used to fit them."""

from types import SimpleNamespace
from typing import Any

import pytest

from idim_iv_ros.diagnosis.result import Gap
from idim_iv_ros.diagnosis.structural import confirmation


class KnownFigures:
    """Of each effect: gain, folds helped of all, gap before and after, interval."""

    refit = 0

    def __init__(self, figures: list[tuple[float, int, int, float, float, Any]]) -> None:
        self.figures = figures

    def gain(self, effect: int) -> tuple[float, int, int]:
        return self.figures[effect][:3]

    def gap(self, before: int, after: int, joint: int) -> Gap:
        _, _, _, one, two, limits = self.figures[before]
        return Gap(one, two, None, None, limits)


def found(joint: int, family: str = "velocity") -> SimpleNamespace:
    return SimpleNamespace(
        candidate=SimpleNamespace(
            place=SimpleNamespace(joint=joint), effect=SimpleNamespace(family=family)
        )
    )


GOOD = (0.3, 5, 5, 1.0, 0.5, (0.3, 0.6))


@pytest.mark.parametrize(
    ("figures", "kept"),
    [
        (GOOD, True),
        ((0.3, 3, 4, 1.0, 0.5, (0.3, 0.6)), True),
        ((0.3, 3, 5, 1.0, 0.5, (0.3, 0.6)), False),  # on too few folds
        ((0.01, 5, 5, 1.0, 0.5, (0.3, 0.6)), False),  # too little
        ((0.3, 5, 5, 1.0, 0.99, (-0.01, 0.03)), False),  # the gap may shrink by chance
        ((0.3, 5, 5, 1.0, 0.9, None), True),  # no interval, but smaller
        ((0.3, 5, 5, 1.0, 1.1, None), False),
    ],
)
def test_an_effect_must_hold(
    figures: tuple[float, int, int, float, float, Any], kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert names([figures], [0], monkeypatch) == ([0] if kept else [])


def test_what_came_later_at_the_joint_goes_with_what_does_not_hold(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bad = (0.0, 1, 5, 1.0, 1.0, (-0.1, 0.1))
    assert names([GOOD, bad, GOOD, GOOD], [0, 0, 0, 1], monkeypatch) == [0, 3]


def test_a_drift_may_lie_in_half_of_the_session(monkeypatch: pytest.MonkeyPatch) -> None:
    half = (0.3, 2, 4, 1.0, 0.5, (0.3, 0.6))
    assert names([half], [0], monkeypatch, "time") == [0]
    assert names([half], [0], monkeypatch) == []


def names(
    figures: list[Any], joints: list[int], monkeypatch: pytest.MonkeyPatch, family: str = "velocity"
) -> list[int]:
    """Places of the effects that are kept."""
    effects = [found(joint, family) for joint in joints]
    monkeypatch.setattr(confirmation, "held_out", lambda *_, **__: KnownFigures(figures))
    monkeypatch.setattr(confirmation, "sized", lambda _, model: list(model.found))
    monkeypatch.setattr(confirmation, "label", lambda *_: "")
    monkeypatch.setattr(
        confirmation,
        "built_model",
        lambda _, kept, __: SimpleNamespace(found=tuple(kept), regression=None, fit=None),
    )
    model = SimpleNamespace(found=tuple(effects), nonparametric=(), regression=None, fit=None)
    nothing: Any = SimpleNamespace()
    kept, _ = confirmation.confirmed(nothing, nothing, model, [], [], None)  # type: ignore[arg-type]
    return [effects.index(each) for each in kept.found]  # type: ignore[arg-type]
