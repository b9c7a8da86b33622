"""A parameter error all of whose numbers may be zero is not named, whichever it is."""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
import pytest

from bags.simulated_arms import arm2
from idim_iv_ros.diagnosis.parametric import sure
from idim_iv_ros.diagnosis.parametric.change_regression import ChangeRegression, change_regression
from idim_iv_ros.diagnosis.parametric.hypotheses import (
    Hypothesis,
    hypotheses,
    of_base_parameters,
)
from idim_iv_ros.diagnosis.parametric.other_errors import Beside
from idim_iv_ros.diagnosis.refit.baseline import baseline, smooth_regression
from idim_iv_ros.effects.parametric_effect import Change, Estimated
from idim_iv_ros.effects.registry import PARAMETRIC
from tests.estimation.test_simulated_arms import recorded

_SURE_TOGETHER = 0.9999  # correlation of numbers of opposite sign: their difference is 50 σ away


@pytest.fixture(scope="module")
def changes() -> ChangeRegression:
    arm = arm2(seconds=8.0)
    data = baseline([recorded(arm, 1)], arm.configuration)
    regression = smooth_regression(data)
    return change_regression(data, regression, regression.fit())


def every(changes: ChangeRegression) -> list[Hypothesis]:
    """Each variant of each effect, and those of the base parameters."""
    return [*hypotheses(changes, PARAMETRIC), *of_base_parameters(changes, PARAMETRIC)]


def estimates(monkeypatch: pytest.MonkeyPatch, values: np.ndarray, covariance: np.ndarray) -> None:
    """Let the estimates beside all other errors be these, whatever is named."""

    def beside(
        changes: ChangeRegression,
        named: Sequence[Change],
        known: Collection[int] = (),
        *,
        one_size: bool = False,
    ) -> Beside:
        deviations = np.sqrt(np.diag(covariance))
        found = tuple(
            Estimated(change, float(value), float(std))
            for change, value, std in zip(named, values, deviations, strict=True)
        )
        return Beside(found, np.ones(1), values[None], covariance[None])

    monkeypatch.setattr(sure, "estimated_beside_other_errors", beside)


def test_numbers_that_are_sure_together_only_name_nothing(
    changes: ChangeRegression, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried = set()
    for each in every(changes):
        count = len(each.changes)
        if count < 2:
            continue
        values = np.array([(-1.0) ** number for number in range(count)])
        covariance = np.full((count, count), _SURE_TOGETHER) + (1.0 - _SURE_TOGETHER) * np.eye(
            count
        )
        estimates(monkeypatch, values, covariance)
        judged = sure.sure_of(changes, [each], with_own_links=True)
        assert judged.kept == ()
        assert [doubtful.hypothesis for doubtful in judged.doubtful] == [each]
        tried.add(each.effect.name)
    assert {"payload", "link_inertia", "gravity_direction", "friction_level"} <= tried


def test_a_single_number_that_may_be_zero_names_nothing(
    changes: ChangeRegression, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried = set()
    estimates(monkeypatch, np.array([1.5]), np.eye(1))
    for each in every(changes):
        if len(each.changes) == 1:
            judged = sure.sure_of(changes, [each])
            assert (judged.kept, judged.doubtful) == ((), ())
            tried.add(each.effect.name)
    assert {"torque_gain", "drive_inertia", "torque_offset"} <= tried


def test_sure_numbers_name_it(changes: ChangeRegression, monkeypatch: pytest.MonkeyPatch) -> None:
    for each in every(changes):
        estimates(monkeypatch, np.full(len(each.changes), 6.0), np.eye(len(each.changes)))
        assert sure.sure_of(changes, [each]).kept == (each,)


def test_a_moment_of_inertia_alone_is_no_payload(
    changes: ChangeRegression, monkeypatch: pytest.MonkeyPatch
) -> None:
    bodies = [each for each in every(changes) if each.effect.name == "payload"]
    body = max(bodies, key=lambda each: len(each.changes))
    names = [change.name for change in body.changes]
    values = np.array([9.0 if name.startswith("inertia") else 1.0 for name in names])
    estimates(monkeypatch, values, np.eye(len(names)))
    assert sure.sure_of(changes, [body]).kept == ()
    values = np.array([9.0 if name == "moment_x" else 1.0 for name in names])
    estimates(monkeypatch, values, np.eye(len(names)))
    assert sure.sure_of(changes, [body]).kept == (body,)


def beside_a_link(
    monkeypatch: pytest.MonkeyPatch, with_link: np.ndarray, one_size: np.ndarray
) -> None:
    """Numbers of deviation one: 0.5 each, but without errors of the link, and of one size."""

    def beside(
        changes: ChangeRegression,
        named: Sequence[Change],
        known: Collection[int] = (),
        **of_size: bool,
    ) -> Beside:
        values = with_link if known else np.full(len(named), 0.5)
        if of_size.get("one_size"):
            values = one_size
        found = tuple(
            Estimated(change, float(value), 1.0)
            for change, value in zip(named, values, strict=True)
        )
        return Beside(found, np.ones(1), values[None], np.eye(len(named))[None])

    monkeypatch.setattr(sure, "estimated_beside_other_errors", beside)


def only(changes: ChangeRegression, body: Hypothesis) -> ChangeRegression:
    """A gap that is all of a body, each number by as much torque."""
    directions = np.column_stack([change.direction for change in body.changes])
    change = directions @ (1.0 / np.linalg.norm(changes.factor @ directions, axis=0))
    return replace(
        changes,
        right=changes.factor @ change,
        residuals=tuple(columns @ change for columns in changes.columns),
    )


def test_what_a_links_error_may_be_is_named_with_the_link(
    changes: ChangeRegression, monkeypatch: pytest.MonkeyPatch
) -> None:
    bodies = [each for each in hypotheses(changes, PARAMETRIC) if each.effect.name == "payload"]
    body = max(bodies, key=lambda each: len(each.changes))
    gap, count = only(changes, body), len(body.changes)
    little, much = np.full(count, 0.5), np.full(count, 6.0)
    for one_size, name in ((much, "payload"), (little, "link_inertia")):
        beside_a_link(monkeypatch, much, one_size)
        assert sure.sure_of(gap, [body]).kept == ()
        judged = sure.sure_of(gap, [body], with_own_links=True)
        assert [each.effect.name for each in judged.kept] == [name]
        assert [each.value for each in judged.numbers[0]] == much.tolist()
        assert len(judged.kept[0].changes) == count
    beside_a_link(monkeypatch, little, much)
    assert sure.sure_of(gap, [body], with_own_links=True).kept == ()


def test_a_sure_number_that_takes_little_of_the_gap_names_no_body(
    changes: ChangeRegression, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The mass may be zero, an error of the link before; beside it a moment is sure."""
    bodies = [each for each in hypotheses(changes, PARAMETRIC) if each.effect.name == "payload"]
    body = max(bodies, key=lambda each: len(each.changes))
    names = [change.name for change in body.changes]
    mass = replace(body, changes=(body.changes[names.index("mass")],))
    beside_a_link(monkeypatch, np.where(np.array(names) == "mass", 0.5, 6.0), np.full(4, 6.0))
    assert sure.sure_of(only(changes, mass), [body], with_own_links=True).kept == ()
