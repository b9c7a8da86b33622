"""What a goal says of its progress while it plans, moves and checks."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest

from idim_iv_interfaces.action import Collect
from idim_iv_ros.nodes.collector import collection, following
from idim_iv_ros.nodes.collector.collection import Collection, Parts
from idim_iv_ros.nodes.settings import CollectorSettings

HANG = 120.0  # s
PASS = SimpleNamespace(duration=30.0)
REPORT = SimpleNamespace(usable=True, findings=[])


class Listener:
    """Hears stages and shares; what computes waits until a share was heard."""

    def __init__(self) -> None:
        self.heard: list[tuple[str, float]] = []
        self._changed = threading.Condition()

    def say(self, stage: str, share: float, error: float, joint: str) -> None:
        with self._changed:
            self.heard.append((stage, share))
            self._changed.notify_all()

    def until(self, stage: str, share: float) -> None:
        with self._changed:
            wanted = (stage, pytest.approx(share))
            assert self._changed.wait_for(lambda: wanted in self.heard, HANG)


def test_share_that_is_done_rises_from_the_planning_on(monkeypatch: pytest.MonkeyPatch) -> None:
    listener = Listener()

    def plan(*arguments: object, progress: object, **request: object) -> tuple:
        for share in (0.25, 0.75):
            progress("condition number < 50", share)
            listener.until("planning", 0.1 * share)
        return None, None, None

    def check(bags: object, configuration: object, progress: object) -> SimpleNamespace:
        progress("reading", 0.5)
        # Three passes of 30 s and half of the check of 5 s, after a tenth for the planning.
        listener.until("checking", 0.1 + 0.9 * 92.5 / 95.0)
        return REPORT

    monkeypatch.setattr(following, "_SIGN_OF_LIFE", 0.0)
    monkeypatch.setattr(collection, "plan_passes", plan)
    monkeypatch.setattr(collection, "check", check)
    passes = SimpleNamespace(approach=PASS, slow=PASS, full=PASS)
    monkeypatch.setattr(collection, "passes_of", lambda *given, **speeds: passes)
    settings = CollectorSettings(allow_motion=True)
    names = ("configuration", "positions", "references", "controller", "recorder", "identifier")
    there = dict.fromkeys(names, SimpleNamespace(missing=str))
    parts = Parts(**there, settings=lambda: settings, gone=lambda: False)
    request = Collect.Goal(duration=20.0, speed_scale=0.5, seed=1, timeout=HANG)
    goal = Collection(request, parts, listener.say)

    def follow(stage: str, motion: object, passes: object) -> None:
        goal._course.begin(stage)
        goal._course.proceed(goal._course.done + PASS.duration, stage)

    monkeypatch.setattr(goal, "_find", lambda wanted: None)
    monkeypatch.setattr(goal, "_asked_position", lambda: np.zeros(2))
    monkeypatch.setattr(goal, "_robot", SimpleNamespace(follow=follow))
    monkeypatch.setattr(
        goal,
        "_record",
        lambda passes: follow("recording", PASS, passes) or SimpleNamespace(name="x"),
    )
    collected = goal.run()
    assert collected.success, collected.message
    shares = [share for _, share in listener.heard]
    assert shares == sorted(shares)
    assert shares[0] == 0.0
    assert ("moving to the start", pytest.approx(0.1)) in listener.heard
