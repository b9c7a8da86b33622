"""Errors that a nominal model may have: of each link's mass, centre and inertia, of each drive.

Every number of a nominal model is off by a little. What is off is physical: a mass moves first
moments and inertias with it. Scaled by a relative size these errors are random effects beside
every comparison.
"""

from dataclasses import replace

import numpy as np
import pinocchio as pin

from idim_iv_ros.identification.prepare import PreparedRegression
from idim_iv_ros.model import DynamicParameters, InverseModel
from idim_iv_ros.types import FloatArray

# Sizes that are compared, of links and of drives: those of a simulator's copy of itself, and those
# of data sheets. In between lies nothing that is made, and there all links together would pass for
# one payload.
RELATIVE_ERRORS = (0.003, 0.03, 0.1, 0.2, 0.4)
# XX, XY, YY, XZ, YZ, ZZ
_ROWS, _COLUMNS = np.array([0, 0, 1, 0, 1, 2]), np.array([0, 1, 1, 2, 2, 2])


def errors_of_links(model: InverseModel) -> FloatArray:
    """Changes (n_standard, k) of the given parameters that are errors of size one of the links.

    Of each link its mass, which moves its first moments and inertia too; its centre of mass along
    each axis, by the usual radius of gyration of the robot's links; and its six central moments
    and products of inertia, by their size.
    """
    given = model.robot.given
    links = [pin.Inertia.FromDynamicParameters(inertia) for inertia in given.inertial]
    mass, moments = given.inertial[:, 0], 0.5 * given.inertial[:, [4, 6, 9]].sum(axis=1)
    present = (mass > 0.0) & (moments > 0.0)
    radii = np.sqrt(moments[present] / mass[present])  # of gyration, about the joints, m
    length = float(np.median(radii)) if len(radii) else 0.0
    columns: list[tuple[int, FloatArray]] = []
    for joint, (link, values) in enumerate(zip(links, given.inertial, strict=True)):
        columns.append((joint, values))
        columns += [(joint, _shifted(link, length * axis)) for axis in np.eye(3)]
        moment = 0.5 * float(np.trace(link.inertia))
        for place, share in zip(range(4, 10), (1.0, 0.5, 1.0, 0.5, 0.5, 1.0), strict=True):
            columns.append((joint, share * moment * np.eye(10)[place]))
    layout = model.regressor.layout
    made = []
    for joint, change in columns:
        inertial = np.zeros_like(given.inertial)
        inertial[joint] = change
        made.append(layout.vector(replace(_nothing(given), inertial=inertial)))
    return np.column_stack(made)


def errors_of_drives(
    model: InverseModel, torque: FloatArray, refit: DynamicParameters
) -> FloatArray:
    """Changes (n_standard, k) that are errors of size one of drive inertia, friction and offsets.

    By the value itself, at least by what is usual of its kind, which for a weak joint is less; a
    joint's offset by its dry friction, and friction of a coupling by the median of the joints.
    `torque` (n_joints,): rms of each joint, N m; `refit` says how large friction is where the
    nominal model has none at all.
    """
    given = model.robot.given
    dry = given.coulomb if np.any(given.coulomb) else refit.coulomb
    slow = given.viscous if np.any(given.viscous) else refit.viscous
    coulomb, viscous = _at_least_usual(dry, torque), _at_least_usual(slow, torque)
    coupled = np.ones_like(given.coupling_viscous)
    sizes = replace(
        _nothing(given),
        drive_inertia=_at_least_usual(given.drive_inertia, torque),
        viscous=viscous,
        coulomb=coulomb,
        offset=coulomb,
        coupling_viscous=float(np.median(viscous)) * coupled,
        coupling_coulomb=float(np.median(coulomb)) * coupled,
    )
    return np.diag(model.regressor.layout.vector(sizes))


def numbers_not_given(prepared: PreparedRegression) -> frozenset[tuple[str, int]]:
    """Kind and joint of numbers of which the nominal model says nothing.

    Friction of joints without dry friction, since every drive has some; and inertia of all drives
    where the configuration gives none.
    """
    given = prepared.model.robot.given
    joints = range(len(given.coulomb))
    friction = {(kind, j) for kind in ("Fv", "Fc") for j in joints if given.coulomb[j] == 0.0}
    drives = {("Ia", j) for j in joints if prepared.armature_missing}
    return frozenset(friction | drives)


def _nothing(given: DynamicParameters) -> DynamicParameters:
    plain = given.of_links
    return replace(plain, inertial=np.zeros_like(plain.inertial))


def _shifted(link: pin.Inertia, shift: FloatArray) -> FloatArray:
    """Change (10,) of a link's parameters about its joint per small shift (3,) of its centre."""
    centre, mass = np.asarray(link.lever), float(link.mass)
    across = np.outer(centre, shift)
    inertia = mass * (2.0 * float(centre @ shift) * np.eye(3) - across - across.T)
    return np.concatenate([[0.0], mass * shift, inertia[_ROWS, _COLUMNS]])


def _at_least_usual(values: FloatArray, torque: FloatArray) -> FloatArray:
    """Sizes of values (n_joints,), at least the median, or the torque by its median if smaller."""
    sizes = np.abs(values)
    present = (sizes > 0.0) & (torque > 0.0)
    if not present.any():
        return sizes
    of_torque = torque * np.median(sizes[present] / torque[present])
    return np.asarray(np.maximum(sizes, np.minimum(np.median(sizes[present]), of_torque)))
