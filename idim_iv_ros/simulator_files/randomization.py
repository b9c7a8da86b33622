"""Ranges for domain randomisation: the uncertainty of an exported model.

Links, loads and drives have their posterior beside the causes. What the recording determines well
hardly varies; where it determines a sum only, the parts vary and the sum does not; what no motion
shows is as uncertain as the nominal numbers prove to be elsewhere.
"""

from typing import Any, NamedTuple

import numpy as np

from idim_iv_ros.physical.pseudo_inertia import LEAST_OF_NOMINAL
from idim_iv_ros.physical.remainder import Uncertainty, lower_root
from idim_iv_ros.simulator_files.named import kind_of
from idim_iv_ros.simulator_files.robot import ExportedRobot

RANDOMIZE = "randomize.py"
_NORMAL = 1.96
_FIELDS = {"Ia": "dof_armature", "Fv": "dof_damping", "Fc": "dof_frictionloss"}


class Ranges(NamedTuple):
    """Ranges in changes.md: usual errors of undetermined parameters, and a row for each body."""

    link: float
    drive: float
    rows: list[tuple[str, ...]]


def randomization(exported: ExportedRobot, model: str) -> tuple[dict[str, Any], Ranges]:
    """Return the variables of the template of `sample(model, rng)`, and the ranges.

    The exported parameters include what no cause explains; `model` is the name of their MJCF.
    """
    remainder = exported.model.remainder
    assert remainder is not None
    uncertainty = remainder.uncertainty
    carried = [("joint", name, body) for name, body in exported.bodies.items()]
    mounted = [("load", link, load.parameters) for link, (_, load) in exported.mounted.items()]
    drives, drive_rows = _drives(exported, uncertainty)
    bodies, lines = [], []
    for number, (kind, name, body) in enumerate([*carried, *mounted]):
        rows = slice(10 * number, 10 * number + 10)
        reference = uncertainty.coordinates.links[number]
        spread = reference.to_parameters @ uncertainty.root[rows]
        mass, centre = float(body[9]), body[6:9] / body[9]
        moved = np.linalg.norm((spread[6:9] - np.outer(centre, spread[9])) / mass, axis=1)
        shift = ", ".join(f"{1e3 * _NORMAL * std:.2g}" for std in moved)
        half = _NORMAL * float(np.linalg.norm(spread[9]))
        of_joint = drives.get(name, {}) if kind == "joint" else {}
        cells = (of_joint.get(field, "–") for field in _FIELDS.values())
        lines.append((name, f"{mass:.4g} ± {half:.2g}", f"± {shift}", *cells))
        bodies.append((kind, name, reference.factor))
    shown = {
        "model": model,
        "origin": exported.origin,
        "bodies": bodies,
        "joints": [(field, joint) for joint, fields in drives.items() for field in fields],
        "least": LEAST_OF_NOMINAL,
        "root": lower_root(uncertainty.root[[*range(10 * len(bodies)), *drive_rows]]),
    }
    return shown, Ranges(uncertainty.link, uncertainty.drive, lines)


def _drives(
    exported: ExportedRobot, uncertainty: Uncertainty
) -> tuple[dict[str, dict[str, str]], list[int]]:
    """Return intervals of joint numbers by joint and MuJoCo's field, and their rows in `root`."""
    coordinates = uncertainty.coordinates
    drives: dict[str, dict[str, str]] = {}
    rows = []
    for row, place in enumerate(coordinates.drives, 10 * len(coordinates.links)):
        name = exported.model.parameters[place].name
        if (kind := kind_of(name)) in _FIELDS:
            joint = exported.robot.joints[int(name[len(kind) :]) - 1]
            half = _NORMAL * float(np.linalg.norm(uncertainty.root[row]))
            interval = f"{exported.model.values[name]:.4g} ± {half:.2g}"
            drives.setdefault(joint, {})[_FIELDS[kind]] = interval
            rows.append(row)
    return drives, rows
