"""Ranges for domain randomisation: what a recording leaves open of an exported model.

The posterior of links, loads and drives beside the causes. What the recording shows well hardly
varies; sums that it shows alone stay while their parts vary; what no motion shows is as uncertain
as the nominal numbers prove to be elsewhere.
"""

import numpy as np

from idim_iv_ros.physical.nearest import LEAST_OF_NOMINAL
from idim_iv_ros.physical.remainder import Uncertainty, lower_root
from idim_iv_ros.simulator_files.named import kind_of
from idim_iv_ros.simulator_files.robot import ExportedRobot

RANDOMIZE = "randomize.py"
_NORMAL = 1.96
_FIELDS = {"Ia": "dof_armature", "Fv": "dof_damping", "Fc": "dof_frictionloss"}
_FILE = '''"""Other robots like {model} by `sample(model, rng)`; from {origin}."""

import copy
import itertools

import mujoco
import numpy as np

# What a joint carries, or a payload, and F of its pseudo-inertia F (1 + S) F.T; in the file S = 0.
BODIES = [
{bodies}
]
JOINTS = [
{joints}
]
LEAST = {least:g}  # eigenvalue of 1 + S
# Root of the covariance of the triangles of all S, and then of the joints.
_ROWS = [
{rows}
]
ROOT = np.array([row + [0.0] * (len(_ROWS) - len(row)) for row in _ROWS])

{sampler}'''
_SAMPLER = '''
def sample(model, rng):
    """Return a copy of the exported model with numbers that the recording cannot tell apart.

    `model`: an mjModel of the exported file; `rng`: a numpy.random.Generator. Masses, centres and
    moments of what each joint carries and of payloads change together and stay those of bodies.
    """
    drawn, data = copy.copy(model), mujoco.MjData(model)
    data.qpos[:] = model.qpos0
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    change, roots = _draw(rng)
    apart = {model.body(name).id for kind, name, _ in BODIES if kind == "load"}
    for (kind, name, factor), root in zip(BODIES, roots):
        if kind == "load":
            body = model.body(name).id
            parts, origin = [body], data.xpos[body]
        else:
            joint = model.joint(name).id
            body, origin = model.jnt_bodyid[joint], data.xanchor[joint]
            welded = range(body, model.nbody)
            parts = [b for b in welded if model.body_weldid[b] == body and b not in apart]
        turn = data.xmat[body].reshape(3, 3)
        mapping = factor @ root @ np.linalg.inv(factor)
        for part in parts:
            if model.body_mass[part] > 0.0:
                _map(model, drawn, data, part, mapping, turn, origin)
    for (field, name), number in zip(JOINTS, change[10 * len(BODIES) :]):
        place = model.jnt_dofadr[model.joint(name).id]
        values = getattr(drawn, field).reshape(model.nv, -1)
        values[place, 0] = max(values[place, 0] + number, 0.0)
    mujoco.mj_setConst(drawn, data)
    return drawn


def _draw(rng):
    """Return changes, and the roots of all 1 + S; again, and smaller, where one is no body's."""
    for attempt in itertools.count():
        change = 0.98**attempt * ROOT @ rng.standard_normal(len(ROOT))
        pseudo = np.zeros((len(BODIES), 4, 4))
        pseudo[:, *np.tril_indices(4)] = change[: 10 * len(BODIES)].reshape(-1, 10)
        pseudo += np.tril(pseudo, -1).swapaxes(1, 2) + np.eye(4)
        values, axes = np.linalg.eigh(pseudo)
        if values.min() > LEAST:
            return change, (axes * np.sqrt(values)[:, None]) @ axes.swapaxes(1, 2)


def _map(model, drawn, data, part, mapping, turn, origin):
    """Map the pseudo-inertia of one body, in the frame of its joint."""
    mass, moments = model.body_mass[part], model.body_inertia[part]
    axes = turn.T @ data.ximat[part].reshape(3, 3)
    centre = turn.T @ (data.xipos[part] - origin)
    pseudo = np.zeros((4, 4))
    pseudo[:3, :3] = axes * (0.5 * moments.sum() - moments) @ axes.T
    pseudo += mass * np.outer([*centre, 1.0], [*centre, 1.0])
    pseudo = mapping @ pseudo @ mapping.T
    mass, centre = pseudo[3, 3], pseudo[:3, 3] / pseudo[3, 3]
    second, axes = np.linalg.eigh(pseudo[:3, :3] - mass * np.outer(centre, centre))
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    own = data.xmat[part].reshape(3, 3)
    drawn.body_mass[part], drawn.body_inertia[part] = mass, second.sum() - second
    drawn.body_ipos[part] = own.T @ (turn @ centre + origin - data.xpos[part])
    mujoco.mju_mat2Quat(drawn.body_iquat[part], (own.T @ turn @ axes).ravel())
'''


def randomization(exported: ExportedRobot, model: str) -> tuple[str, list[str]]:
    """Return `sample(model, rng)` as a file, and a table of what it varies for changes.md.

    The exported parameters hold what no cause explains; `model` is the name of their MJCF.
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
        cells = [of_joint.get(field, "–") for field in _FIELDS.values()]
        lines.append(f"| {name} | {mass:.4g} ± {half:.2g} | ± {shift} | {' | '.join(cells)} |")
        factor = ", ".join(
            f"[{', '.join(f'{value:.9g}' for value in row)}]" for row in reference.factor
        )
        bodies.append(f'    ("{kind}", "{name}", np.array([{factor}])),')
    root = lower_root(uncertainty.root[[*range(10 * len(bodies)), *drive_rows]])
    text = _FILE.format(
        model=model,
        origin=exported.origin,
        bodies="\n".join(bodies),
        joints="\n".join(
            f'    ("{field}", "{joint}"),' for joint, fields in drives.items() for field in fields
        ),
        least=LEAST_OF_NOMINAL,
        rows="\n".join(
            f"    [{', '.join(f'{value:.6g}' for value in row[: number + 1])}],"
            for number, row in enumerate(root)
        ),
        sampler=_SAMPLER,
    )
    return text, [
        "## Ranges",
        "",
        "95 % intervals of what each joint carries, and of its drive. What no motion shows is "
        f"taken to be off by {100.0 * uncertainty.link:.1f} % (links) and "
        f"{100.0 * uncertainty.drive:.1f} % (drives and friction): as nominal numbers prove to be "
        f"elsewhere, at least 1 %. Many vary only together: {RANDOMIZE} draws them so.",
        "",
        "| | mass, kg | centre, mm | armature | damping | friction |",
        "|---|---|---|---|---|---|",
        *lines,
        "",
    ]


def _drives(
    exported: ExportedRobot, uncertainty: Uncertainty
) -> tuple[dict[str, dict[str, str]], list[int]]:
    """Intervals of the numbers of joints, by joint and MuJoCo's field, and their rows in `root`."""
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
