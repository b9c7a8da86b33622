"""Which effects are kept, from what they do on data that was not used to fit them."""

from types import SimpleNamespace
from typing import Any, NamedTuple

import pytest

from idim_iv_ros.diagnosis import sentences
from idim_iv_ros.diagnosis.result import Gap
from idim_iv_ros.diagnosis.structural import confirmation
from idim_iv_ros.diagnosis.structural.confirmation import FoldTest
from idim_iv_ros.diagnosis.structural.cross_fitting import Chosen
from idim_iv_ros.effects.contribution import Load
from idim_iv_ros.effects.effect import Place
from idim_iv_ros.effects.load_dependent_friction import LoadDependentFriction, LoadShape


class KnownFigures:
    """Of each effect: gain, folds helped of all, gap before and after, interval.

    Every fold counts as much as any other, unless the part that is helped is given.
    """

    refit = 0

    def __init__(
        self,
        figures: list[tuple[float, int, int, float, float, Any]],
        helped: tuple[float, bool] | None = None,
    ) -> None:
        self.figures, self.known = figures, helped

    def helped(self, effect: int) -> tuple[float, bool]:
        _, folds, count, *_ = self.figures[effect]
        return self.known or (folds / count, True)

    def gain(self, effect: int) -> tuple[float, int, int]:
        return self.figures[effect][:3]

    def surely_helped(self, effect: int) -> bool:
        limits = self.figures[effect][5]
        return limits is None or limits[0] > 0.0

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
        ((0.3, 5, 5, 1.0, 0.99, (-0.01, 0.03)), False),  # it may help by chance
        ((0.3, 5, 5, 1.0, 0.9, None), True),
        ((0.3, 5, 5, 1.0, 1.1, None), False),  # the torque gap grows
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


def test_a_warm_up_far_below_the_noise_is_a_hint(monkeypatch: pytest.MonkeyPatch) -> None:
    little = (0.03, 5, 5, 1.0, 0.5, (0.3, 0.6))
    assert names([little], [0], monkeypatch) == [0]
    assert names([little], [0], monkeypatch, "time") == []


@pytest.mark.parametrize(
    ("times", "folds", "kept"), [(5, 5, True), (3, 5, True), (2, 5, False), (2, 3, True)]
)
def test_what_few_folds_choose_is_a_hint(
    times: int, folds: int, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    chosen = [Chosen(times, times, folds)]
    figures = (0.3, times, folds, 1.0, 0.5, (0.3, 0.6))
    found = judged([figures], [0], monkeypatch, chosen=chosen, helped=(1.0, True))
    assert [place for place, _ in found.hints] == ([] if kept else [0])
    assert kept or f"only {times} of {folds} folds" in found.hints[0][1]


def test_folds_count_by_what_the_effect_does_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """Play acts at reversals under load: where it does nothing, a fold helps by chance."""
    half = (0.4, 3, 6, 1.0, 0.4, (0.5, 0.8))
    assert judged([half], [0], monkeypatch).kept == []
    assert judged([half], [0], monkeypatch, helped=(0.97, True)).kept == [0]
    most = (0.4, 5, 6, 1.0, 0.4, (0.5, 0.8))
    (hint,) = judged([most], [0], monkeypatch, helped=(0.4, True)).hints
    assert "in which 40 % of what it does lies" in hint[1]


def test_what_one_stretch_of_time_alone_supports_is_a_hint(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (hint,) = judged([GOOD], [0], monkeypatch, helped=(0.97, False)).hints
    assert "one stretch of time" in hint[1]


def test_what_is_indistinguishable_stands_in(monkeypatch: pytest.MonkeyPatch) -> None:
    chosen = [Chosen(own=1, standing_in=5, folds=5)]
    assert judged([GOOD], [0], monkeypatch, chosen=chosen).kept == [0]


def test_folds_that_do_not_choose_it_cannot_speak_against_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    figures = (0.3, 3, 5, 1.0, 0.5, (0.3, 0.6))
    chosen = [Chosen(3, 3, 5)]  # it does nothing in the others
    assert judged([figures], [0], monkeypatch, chosen=chosen, helped=(1.0, True)).kept == [0]
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
    helped: tuple[float, bool] | None = None,
) -> Judgement:
    effects = [found(joint, family, number) for number, joint in enumerate(joints)]
    times = chosen or [Chosen(each[2], each[2], each[2]) for each in figures]

    def tested(_: Any, model: Any, *__: Any) -> FoldTest:
        which = [effects.index(each) for each in model.found]
        known: Any = KnownFigures([figures[k] for k in which], helped)
        return FoldTest(known, tuple(times[k] for k in which))

    monkeypatch.setattr(confirmation, "tested", tested)
    monkeypatch.setattr(
        confirmation, "impossible", lambda _, model, __: [impossible] * len(model.found)
    )
    monkeypatch.setattr(confirmation, "sized", lambda _, model: list(model.found))
    monkeypatch.setattr(confirmation, "blurred_names", lambda _, __, ___: [])
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


@pytest.mark.parametrize(
    ("known", "families", "hints"),
    [
        (True, ["frequency"], 0),
        (False, [], 0),
        (False, ["velocity"], 0),  # of its own family: one finding, two names
        (False, ["velocity", "frequency"], 1),
    ],
)
def test_an_effect_without_numbers_is_named_if_nothing_of_another_kind_predicts_as_well(
    known: bool, families: list[str], hints: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    others = tuple((found(0, family).candidate, 0.9) for family in families)
    only = found(0)
    only.indistinguishable_from = others
    monkeypatch.setattr(confirmation, "numbers_differ_from_nothing", lambda *_: known)
    model: Any = SimpleNamespace(found=(only,), regression=SimpleNamespace(widths=(1,)), fit=None)
    data: Any = SimpleNamespace(joints=("elbow",))
    made = confirmation.blurred_names(data, model, [Chosen(5, 5, 5)])
    assert len(made) == hints
    assert all("each of its numbers may be zero, and x at elbow" in each.reason for each in made)


@pytest.mark.parametrize("together", [False, True])
def test_numbers_that_are_known_together_only_are_said_to_be(together: bool) -> None:
    data: Any = SimpleNamespace(joints=("elbow",), unit_at=lambda joint, unit: unit)
    effect: Any = SimpleNamespace(
        place=Place(0), effect=LoadDependentFriction(), shape=LoadShape(1.0, 5.0, True, Load.STATIC)
    )
    gap = Gap(1.0, 0.5, None, 0.5, (0.4, 0.6))
    text = sentences.structural_cause(data, effect, [], gap, 0.4, together=together)
    assert ("each of its numbers by itself is not" in text) == together
    assert "Coriolis" in text
