"""A gap.json in which one thing is wrong is exported or refused in one line, never half."""

import copy
import json
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import pytest

from idim_iv_ros.errors import IdimError
from tests.simulator_files.cases import case, cause

WRONG = (None, 0, -1, 1e300, -1e300, 1e-300, "x", "", [], {}, True, 1e9, -1e-9)
CAUSES = (
    cause("stribeck", "joint_1", excess=1.0, speed=0.1),
    cause("nonlinear_viscous", "joint_2", coefficient=0.3, power=2.0),
    cause("time_delay", None, delay=0.003),
    cause("spring", "joint_1", linear=2.0, lowest=-9.0, highest=9.0),
    cause("controller_mismatch", "joint_1", kp=500.0),
)
READ = ("physical", "causes", "kinematics", "joints", "why_no_physical", "format")


def places(content: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Keys that lead to every value."""
    keys = content.keys() if isinstance(content, dict) else range(len(content))
    for key in keys:
        yield (*path, key)
        if isinstance(content[key], dict | list):
            yield from places(content[key], (*path, key))


@pytest.mark.parametrize("seed", range(4))
def test_one_thing_wrong(tmp_path: Path, seed: int) -> None:
    arm = case(tmp_path, "arm2", CAUSES)
    whole = json.loads(arm.path.read_text(encoding="utf-8"))
    choices = [place for place in places(whole) if place[0] in READ]
    chance, outcomes = random.Random(seed), set()
    for number in range(30):
        content, place = copy.deepcopy(whole), chance.choice(choices)
        inside = content
        for key in place[:-1]:
            inside = inside[key]
        if chance.random() < 0.15:
            del inside[place[-1]]
        else:
            inside[place[-1]] = chance.choice(WRONG)
        arm.path.write_text(json.dumps(content), encoding="utf-8")
        out = tmp_path / str(number)
        try:
            made = arm.export(out)
        except IdimError as refusal:
            assert "\n" not in str(refusal) and not out.exists()
            outcomes.add("refused")
        else:
            mujoco.MjModel.from_xml_path(str(made.mjcf))
            outcomes.add("exported")
    assert outcomes == {"refused", "exported"}
