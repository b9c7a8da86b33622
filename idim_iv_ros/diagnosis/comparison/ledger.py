"""Rows of one equation: what the nominal model leaves, errors of its numbers, and the noise.

Every number of a nominal model is off by a little, and what is off is physical: a mass moves first
moments and inertias with it. Scaled by a relative size these errors are random effects beside every
comparison.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pinocchio as pin

from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.held_out import row_blocks
from idim_iv_ros.estimation.likelihood import Columns, noise_model, rms
from idim_iv_ros.estimation.qr import Basis, independent_basis
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.identification.prepare import PreparedRegression
from idim_iv_ros.model import DynamicParameters, InverseModel
from idim_iv_ros.signals.autoregression import AutoregressiveModel
from idim_iv_ros.types import FloatArray, IntArray, SingleArray

BLOCK = 2.5  # s: rows this far apart are taken as independent
_CLEAR = 3.0 * 1.4826  # three standard deviations, in medians of moduli
_FREE = 100.0  # torque that a unit of a number without a given value makes, times the joint's
# Sizes that are compared, of links and of drives: those of a simulator's copy of itself, and those
# of data sheets. In between lies nothing that is made, and there all links together would pass for
# one payload.
RELATIVE_ERRORS = (0.003, 0.03, 0.1, 0.2, 0.4)
# XX, XY, YY, XZ, YZ, ZZ: places, and shares of the usual moment, after mass and first moments
_SHARES_OF_MOMENT = [0.0] * 4 + [1.0, 0.5, 1.0, 0.5, 0.5, 1.0]
_ROWS, _COLUMNS = np.array([0, 0, 1, 0, 1, 2]), np.array([0, 1, 1, 2, 2, 2])


@dataclass(frozen=True, eq=False)
class Ledger:
    """Rows r = y − X β₀ of all joints, and the physical errors of β₀ (changes of it, (b, k))."""

    joints: tuple[JointRows, ...]  # X of each joint
    gap: tuple[FloatArray, ...]  # (r_j,) what the nominal model leaves, N m (N)
    sizes: FloatArray  # (n_joints,) rms of the recorded torque
    link_errors: FloatArray  # of relative size one
    drive_errors: FloatArray  # of relative size one
    free_errors: FloatArray  # of any size: of numbers that the nominal model lacks
    blocks: tuple[IntArray, ...]  # (r_j,) stretch of time of each row, over all recordings
    unsampled: tuple[FloatArray, ...]  # (r_j,) content at half the rate of the recording
    nominal: bool  # whether there are given numbers; else every number is free

    @property
    def parameters(self) -> int:
        """How many base parameters there are, b."""
        return len(self.link_errors)

    def errors(self, sizes: tuple[float, float]) -> FloatArray:
        """Changes (b, k) that are usual where errors of links and of drives have these sizes."""
        usual = sizes[0] * self.link_errors, sizes[1] * self.drive_errors
        return np.hstack([*usual, self.free_errors])

    def shares(self, columns: Columns, coefficients: FloatArray) -> FloatArray:
        """RMS (n_joints,) of a torque over that of the joint, without what free numbers take.

        `columns` (r_j, w), `coefficients` (w,): the torque is their product.
        """
        made = np.zeros(len(self.sizes))
        for joint, table in columns.items():
            torque = self._of_free_numbers[joint].remove(table @ coefficients)
            made[joint] = rms(torque) / float(self.sizes[joint])
        return made

    @cached_property
    def _of_free_numbers(self) -> list[Basis]:
        """Torques of the free numbers at each joint."""
        return [
            independent_basis(rows.matrix @ self.free_errors[rows.columns]) for rows in self.joints
        ]

    @property
    def block_count(self) -> int:
        """How many stretches of time there are."""
        return 1 + max(int(block.max()) for block in self.blocks if len(block))


def torque_ledger(data: Baseline, *, free: bool = False) -> Ledger:
    """Rows of the torque on the smooth motion, with the nominal model's numbers.

    `free`: whether every number is free, whatever the nominal model says.
    """
    given = None if free else data.prepared.given
    regression, joints, sizes = data.regression, data.rows, data.torque_sizes
    if given is None:
        values = regression.fitted.values
        links = _of_free_size(joints, sizes, np.eye(regression.parameters))
        drives = free_errors = np.zeros((regression.parameters, 0))
    else:
        values, model = given, data.prepared.model
        grouping = np.asarray(model.base.grouping)
        refit = model.dynamic_parameters(data.estimate.linear.values)
        links = grouping @ errors_of_links(model)
        drives = grouping @ errors_of_drives(model, sizes, refit)
        missing = numbers_not_given(data.prepared)
        numbers = model.regressor.layout.parameters
        chosen = [(number.kind, number.joint) in missing for number in numbers]
        free_errors = _of_free_size(joints, sizes, grouping[:, chosen])
    gap = tuple(np.zeros(len(rows)) if rows.left_out else rows.residual(values) for rows in joints)
    changes, blocks = (links, drives, free_errors), row_blocks(data, BLOCK)
    # What alternates, at the rows: shocks shorter than two samples leave it, and errors with it.
    parts = []
    for motion in data.prepared.motions:
        torque = motion.signals.torque.copy()
        torque[1::2] *= -1.0
        parts.append(motion.decimation.whole(torque[motion.span]))
    alternating = [data.counting(j, [part[:, j] for part in parts]) for j in range(len(joints))]
    return Ledger(joints, gap, sizes, *changes, blocks, tuple(alternating), given is not None)


def _of_free_size(
    joints: tuple[JointRows, ...], sizes: FloatArray, changes: FloatArray
) -> FloatArray:
    """Changes (b, k) whose torque is far larger than the recorded one."""
    shares = [
        np.sqrt(np.mean((rows.matrix @ changes[rows.columns]) ** 2, axis=0)) / size
        for rows, size in zip(joints, sizes, strict=True)
    ]
    return np.asarray(changes * _FREE / np.maximum(np.max(shares, axis=0), 1e-12))


@dataclass(frozen=True, eq=False)
class RowNoise:
    """Noise of one joint's rows: a model of it over its scale (r,), 1 where it is usual."""

    model: AutoregressiveModel
    scale: FloatArray

    def standardized(self, rows: FloatArray | SingleArray, segments: Sequence[slice]) -> FloatArray:
        """Whiten rows (r, …) so that the noise has unit variance."""
        return self.model.standardized(rows / self._scale(rows), segments)

    def drawn_back(self, rows: FloatArray, segments: Sequence[slice]) -> FloatArray:
        """Wᵀ rows (r, …), W being the whitening: xᵀ (Wᵀ y) = (W x)ᵀ y without whitening x."""
        return self.model.standardized_adjoint(rows, segments) / self._scale(rows)

    def _scale(self, rows: FloatArray | SingleArray) -> FloatArray:
        return self.scale.reshape(-1, *(1,) * (rows.ndim - 1)).astype(rows.dtype)


def noise_of(ledger: Ledger, residuals: Sequence[FloatArray]) -> tuple[RowNoise, ...]:
    """Noise of each joint's residual (r_j,)."""
    made = []
    for rows, left, missed in zip(ledger.joints, residuals, ledger.unsampled, strict=True):
        scale = np.ones(len(left)) if rows.left_out else scale_of(left, missed)
        made.append(RowNoise(noise_model(rows, left / scale), scale))
    return tuple(made)


def scale_of(residual: FloatArray, unsampled: FloatArray) -> FloatArray:
    """Scale (r,) of the noise of a residual to which torque is added that sampling may have missed.

    `unsampled`: (r,) content at half the rate of the recording, N m (N): what lies beyond is about
    as large, and has come down to the rows. Below the level that it usually has it is noise.
    """
    usual = float(np.median(residual**2)) * 1.4826**2
    missed = unsampled**2 - _CLEAR**2 * float(np.median(unsampled**2))
    return np.sqrt(1.0 + np.maximum(missed, 0.0) / max(usual, 1e-300))


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
    made = []
    for joint, (link, values) in enumerate(zip(links, given.inertial, strict=True)):
        moment = 0.5 * float(np.trace(link.inertia))
        changes = [values, *(_shifted(link, length * axis) for axis in np.eye(3))]
        changes += list(moment * np.diag(_SHARES_OF_MOMENT)[4:])
        for change in changes:
            inertial = np.zeros_like(given.inertial)
            inertial[joint] = change
            made.append(model.regressor.layout.vector(replace(given.of_links, inertial=inertial)))
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
        given.of_links,
        inertial=np.zeros_like(given.inertial),
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
