"""Which effects are kept, from what they do on data that was not used to fit them."""

from types import SimpleNamespace
from typing import Any, NamedTuple

import pytest

from idim_iv_ros.diagnosis.result import Gap
from idim_iv_ros.diagnosis.structural import confirmation
from idim_iv_ros.diagnosis.structural.confirmation import FoldTest
from idim_iv_ros.diagnosis.structural.cross_fitting import Chosen


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


def found(joint: int, family: str = "velocity", number: int = 0) -> SimpleNamespace:
    return SimpleNamespace(
        number=number,
        candidate=SimpleNamespace(
            place=SimpleNamespace(joint=joint), effect=SimpleNamespace(family=family, name="x")
        ),
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


@pytest.mark.parametrize(
    ("times", "folds", "kept"), [(5, 5, True), (3, 5, True), (2, 5, False), (2, 3, True)]
)
def test_what_few_folds_choose_is_a_hint(
    times: int, folds: int, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    chosen = [Chosen(times, times, folds)]
    found = judged([(0.3, times, folds, 1.0, 0.5, (0.3, 0.6))], [0], monkeypatch, chosen=chosen)
    assert [place for place, _ in found.hints] == ([] if kept else [0])
    assert kept or f"only {times} of {folds} folds" in found.hints[0][1]


def test_what_surely_takes_half_of_the_gap_may_act_in_some_folds_only(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for low, kept in ((0.55, [0]), (0.45, [])):
        assert names([(0.5, 4, 6, 1.0, 0.4, (low, 0.8))], [0], monkeypatch) == kept
    assert names([(0.5, 3, 6, 1.0, 0.4, (0.55, 0.8))], [0], monkeypatch) == []


def test_what_is_indistinguishable_stands_in(monkeypatch: pytest.MonkeyPatch) -> None:
    chosen = [Chosen(own=1, standing_in=5, folds=5)]
    assert judged([GOOD], [0], monkeypatch, chosen=chosen).kept == [0]


def test_folds_that_do_not_choose_it_cannot_speak_against_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    figures = (0.3, 3, 5, 1.0, 0.5, (0.3, 0.6))
    assert judged([figures], [0], monkeypatch, chosen=[Chosen(3, 3, 5)]).kept == [0]
    assert judged([figures], [0], monkeypatch, chosen=[Chosen(5, 5, 5)]).kept == []


def test_what_no_arm_has_is_a_hint_however_well_it_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    result = judged([GOOD], [0], monkeypatch, impossible="the link would swing at 3.5 Hz")
    assert result.kept == []
    assert result.hints == [(0, "the link would swing at 3.5 Hz")]
    assert result.outside == [0]  # its torque is there, and is not named


def test_what_no_arm_has_and_does_not_hold_is_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    too_little = (0.01, 5, 5, 1.0, 0.5, (0.3, 0.6))
    result = judged([too_little], [0], monkeypatch, impossible="the link would swing at 3.5 Hz")
    assert (result.kept, result.outside) == ([], [])


class Judgement(NamedTuple):
    outside: list[int]
    kept: list[int]
    hints: list[tuple[int, str]]


def names(
    figures: list[Any], joints: list[int], monkeypatch: pytest.MonkeyPatch, family: str = "velocity"
) -> list[int]:
    """Places of the effects that are kept; all folds choose all of them."""
    return judged(figures, joints, monkeypatch, family).kept


def judged(
    figures: list[Any],
    joints: list[int],
    monkeypatch: pytest.MonkeyPatch,
    family: str = "velocity",
    chosen: list[Chosen] | None = None,
    impossible: str = "",
) -> Judgement:
    effects = [found(joint, family, number) for number, joint in enumerate(joints)]
    times = chosen or [Chosen(each[2], each[2], each[2]) for each in figures]

    def tested(_: Any, model: Any, *__: Any) -> FoldTest:
        which = [effects.index(each) for each in model.found]
        known: Any = KnownFigures([figures[k] for k in which])
        return FoldTest(known, tuple(times[k] for k in which))

    monkeypatch.setattr(confirmation, "tested", tested)
    monkeypatch.setattr(
        confirmation, "impossible", lambda _, model, __: [impossible] * len(model.found)
    )
    monkeypatch.setattr(confirmation, "sized", lambda _, model: list(model.found))
    monkeypatch.setattr(
        confirmation,
        "built_model",
        lambda _, kept, outside: SimpleNamespace(
            found=tuple(kept), nonparametric=tuple(outside), regression=None, fit=None
        ),
    )
    model: Any = SimpleNamespace(found=tuple(effects), nonparametric=(), regression=None, fit=None)
    nothing: Any = SimpleNamespace()
    result = confirmation.confirmed(nothing, nothing, model, [], nothing)
    kept: list[Any] = list(result.model.found)
    hints: list[Any] = list(result.doubtful)
    outside: list[Any] = list(result.model.nonparametric)
    return Judgement(
        [effects.index(each) for each in outside],
        [effects.index(each) for each in kept],
        [(effects.index(each.found), each.reason) for each in hints],
    )
