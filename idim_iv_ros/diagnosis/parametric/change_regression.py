"""The nominal model's residual, whitened, on all changes of its numbers that are searched."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.identifiability.testability import too_little
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.structural.candidate import operating_range
from idim_iv_ros.diagnosis.structural.likelihood import Fit, Regression
from idim_iv_ros.effects.parametric_effect import Change, Estimated, ParameterSpace
from idim_iv_ros.estimation.qr import NOT_SHOWN, independent_basis, r_factor
from idim_iv_ros.model import RobotModel
from idim_iv_ros.simulation import inverse_dynamics
from idim_iv_ros.types import FloatArray


@dataclass(frozen=True)
class Explained:
    """What some changes explain together.

    Attributes
    ----------
    statistic : float
        Energy of the whitened residual that goes (chi-square if there is nothing to explain).
    rank : int
        How many independent directions the changes have on this recording.
    found : tuple of Estimated
        In the order of the changes.
    contributions : (d, m)
        Direction times estimate of each change, in the coordinates of the space.
    """

    statistic: float
    rank: int
    found: tuple[Estimated, ...]
    contributions: FloatArray


@dataclass(frozen=True)
class Accepted:
    """Structural effects that were accepted, their a coefficients free beside any change.

    Attributes
    ----------
    columns : tuple of (r_j, a)
        Rows of unit coefficients, N m, not whitened.
    of_residual : (a,)
        Coefficients that fit the nominal model's residual best, whitened.
    of_changes : (a, d)
        How far a unit of each change moves them.
    """

    columns: tuple[FloatArray, ...]
    of_residual: FloatArray
    of_changes: FloatArray

    def torques(self, contribution: FloatArray) -> list[FloatArray]:
        """Their torque (r_j,) at each joint beside a change (d,), N m."""
        coefficients = self.of_residual - self.of_changes @ contribution
        return [columns @ coefficients for columns in self.columns]


@dataclass(frozen=True)
class ChangeRegression:
    """Least squares of y − X β₀ on changes of the given numbers, whitened and reduced.

    Accepted structural effects are taken out of both sides.

    Attributes
    ----------
    space : ParameterSpace
    factor : (e, d)
        Whitened rows of unit changes, reduced by QR.
    right : (e,)
        The residual likewise; its energy is that of all rows.
    columns : tuple of (r_j, d)
        Rows of unit changes, N m, not whitened.
    residuals : tuple of (r_j,)
        y − X β₀ of each joint, N m.
    torques : tuple of (r_j,)
        y of each joint, N m.
    accepted : Accepted
    still : frozenset of int
        Joints that move too little to tell anything of them.
    """

    space: ParameterSpace
    factor: FloatArray
    right: FloatArray
    columns: tuple[FloatArray, ...]
    residuals: tuple[FloatArray, ...]
    torques: tuple[FloatArray, ...]
    accepted: Accepted
    still: frozenset[int] = frozenset()

    @property
    def rows(self) -> int:
        """Of all joints."""
        return sum(len(residual) for residual in self.residuals)

    @property
    def sizes(self) -> FloatArray:
        """RMS of the torque of each joint, (n_joints,) N m (N)."""
        rms = [float(np.sqrt(np.mean(torque**2))) for torque in self.torques]
        return np.maximum(rms, 1e-300)

    @property
    def energy(self) -> float:
        """Of the whitened residual of the nominal model."""
        return float(self.right @ self.right)

    @property
    def base_parameters(self) -> list[Change]:
        """A change of each base parameter."""
        space = self.space
        names, units = space.model.base.names, space.model.base.units
        unit = np.eye(space.size)
        return [Change(names[k], units[k], unit[k]) for k in range(len(space.given))]

    def refit(self) -> Explained:
        """Everything that new base parameters explain."""
        return self.explain(self.base_parameters)

    @cached_property
    def refit_share(self) -> float:
        """Share of the gap's energy that new base parameters take, as `share`."""
        return self.share(self.refit().contributions.sum(axis=1))

    def explain(self, changes: Sequence[Change]) -> Explained:
        """Fit changes; those that the recording cannot tell apart get no deviation."""
        if not changes:
            return Explained(0.0, 0, (), np.zeros((self.space.size, 0)))
        directions = np.column_stack([change.direction for change in changes])
        white = self.factor @ directions
        norms = np.linalg.norm(white, axis=0)
        scale = 1.0 / np.where(norms > 0.0, norms, 1.0)
        left, singular, right = np.linalg.svd(white * scale, full_matrices=False)
        rank = int(np.sum(singular > settings.LEAST_DIRECTION))
        seen = right[:rank].T  # (m, rank)
        coordinates = left[:, :rank].T @ self.right
        values = scale * (seen @ (coordinates / singular[:rank]))
        deviations = scale * np.linalg.norm(seen / singular[:rank], axis=1)
        determined = np.linalg.norm(seen, axis=1) > 1.0 - 1e-6
        found = tuple(
            Estimated(change, float(value), float(std) if sure else None)
            for change, value, std, sure in zip(
                changes, values, deviations, determined, strict=True
            )
        )
        statistic = float(coordinates @ coordinates)
        return Explained(statistic, rank, found, directions * values)

    def rms(self, contribution: FloatArray) -> tuple[FloatArray, FloatArray]:
        """RMS of each joint's residual (n_joints,) N m, before and after a change (d,).

        The accepted effects are in the model both times, their coefficients free.
        """
        effects = self.accepted.torques(contribution)
        before = [np.sqrt(np.mean(rest**2)) for rest in self._without_changes]
        after = [
            np.sqrt(np.mean((residual - columns @ contribution - effect) ** 2))
            for residual, columns, effect in zip(self.residuals, self.columns, effects, strict=True)
        ]
        return np.array(before), np.array(after)

    @cached_property
    def _without_changes(self) -> list[FloatArray]:
        """Residual (r_j,) of the nominal model with the accepted effects alone."""
        effects = self.accepted.torques(np.zeros(self.space.size))
        return [residual - effect for residual, effect in zip(self.residuals, effects, strict=True)]

    def share(self, contribution: FloatArray) -> float:
        """Share of the gap's energy that a change (d,) takes away, joints by their torques."""
        before, after = self.rms(contribution)
        weights = np.array([1.0 / max(float(np.var(torque)), 1e-300) for torque in self.torques])
        weights *= [len(torque) for torque in self.torques]
        gap = float(np.sum(weights * before**2))
        return 1.0 - float(np.sum(weights * after**2)) / gap if gap > 0.0 else 0.0


def change_regression(data: Baseline, regression: Regression, fit: Fit) -> ChangeRegression:
    """Regress what the nominal model leaves.

    Parameters
    ----------
    regression
        With the accepted structural effects as added columns.
    fit
        Of that regression; its noise models whiten.
    """
    model = data.prepared.model
    axes = level_axes(np.asarray(model.robot.pinocchio.gravity.linear))
    still = still_joints(data)
    moving = frozenset(range(len(data.joints))) - still
    bare = moving if data.prepared.armature_missing else frozenset()
    space = ParameterSpace(model, model.given, axes, bare)
    b = regression.parameters
    columns, effects, residuals, whitened = [], [], [], []
    units = change_rows(data, regression, space)
    for joint, (rows, unit) in enumerate(zip(regression.joints, units, strict=True)):
        extended = regression.extended[joint]
        structural = np.zeros((len(rows), regression.total - b))
        own = len(rows.columns)
        structural[:, extended.columns[own:] - b] = extended.matrix[:, own:]
        residual = rows.residual(space.given)
        if rows.left_out:  # no share of the gap either
            structural, unit, residual = (np.zeros_like(x) for x in (structural, unit, residual))
        table = np.column_stack([structural, unit, residual])
        whitened.append(fit.noise_models[joint].standardized(table, rows.segments))
        columns.append(unit)
        effects.append(structural)
        residuals.append(residual)
    torques = [rows.torque for rows in regression.joints]
    return reduced(space, whitened, columns, residuals, torques, effects, still)


def reduced(
    space: ParameterSpace,
    whitened: Sequence[FloatArray],
    columns: Sequence[FloatArray],
    residuals: Sequence[FloatArray],
    torques: Sequence[FloatArray],
    free: Sequence[FloatArray],
    still: frozenset[int],
) -> ChangeRegression:
    """Reduce rows to those of changes beside columns whose coefficients are free.

    Parameters
    ----------
    whitened : one (r_j, a + d + 1) array for each joint
        Free columns, unit changes and the residual, whitened.
    columns, residuals, torques, free
        (r_j, d), (r_j,), (r_j,) and (r_j, a), not whitened, N m (N).
    still
        Joints that move too little.
    """
    factor, moved = _beside(np.vstack(whitened), free[0].shape[1])
    return ChangeRegression(
        space,
        factor[:, :-1],
        factor[:, -1],
        tuple(columns),
        tuple(residuals),
        tuple(torques),
        Accepted(tuple(free), moved[:, -1], moved[:, :-1]),
        still,
    )


def still_joints(data: Baseline) -> frozenset[int]:
    """Joints that move too little to show any change."""
    covered = operating_range(data)
    return frozenset(joint for joint in range(len(data.joints)) if too_little(joint, covered))


def change_rows(
    data: Baseline, regression: Regression, space: ParameterSpace
) -> tuple[FloatArray, ...]:
    """Rows (r_j, d) of unit changes of all numbers of a space, for each joint, N m."""
    b, units = regression.parameters, []
    gravity = _gravity_rows(data, space.axes)
    for joint, rows in enumerate(regression.joints):
        unit = np.zeros((len(rows), space.size))
        unit[:, rows.columns] = rows.matrix
        unit[:, b : b + 2] = gravity[joint]
        unit[:, b + 2 + joint] = rows.prediction(space.given)
        units.append(unit)
    return tuple(units)


def level_axes(gravity: FloatArray) -> FloatArray:
    """Two unit vectors (2, 3) at right angles to gravity, as near to x, y, z as they can be."""
    size = float(np.linalg.norm(gravity))
    if size == 0.0:
        return np.eye(3)[:2]
    down = gravity / size
    kept = sorted(range(3), key=lambda axis: abs(down[axis]))[:2]
    first = np.eye(3)[min(kept)]
    first = first - (first @ down) * down
    first = first / np.linalg.norm(first)
    second = np.cross(down, first)
    return np.array([first, second if second[max(kept)] > 0.0 else -second])


def _beside(rows: FloatArray, added: int) -> tuple[FloatArray, FloatArray]:
    """R factor of the rows less what the first `added` columns explain, and their coefficients.

    Returns
    -------
    (e, d + 1), (added, d + 1)
    """
    factor = r_factor(rows)
    basis = independent_basis(factor[:, :added], tolerance=NOT_SHOWN)
    whole = factor[:, added:]
    rest = basis.remove(whole)
    # A free curve of the speed holds the joint's dry friction: what is left of that is rounding.
    little = settings.LEAST_BESIDE_EFFECTS * np.linalg.norm(whole, axis=0)
    little[-1] = 0.0  # of the residual all counts
    rest[:, np.linalg.norm(rest, axis=0) < little] = 0.0
    return r_factor(rest), basis.solve(whole, added)


def _gravity_rows(data: Baseline, axes: FloatArray) -> list[FloatArray]:
    """Torque per small rotation of gravity about each axis: (r_j, 2) for each joint, N m/rad."""
    gravity = np.asarray(data.prepared.model.robot.pinocchio.gravity.linear)
    return unit_gravity_rows(data, np.array([np.cross(axis, gravity) for axis in axes]))


def unit_gravity_rows(data: Baseline, accelerations: FloatArray) -> list[FloatArray]:
    """Torque of the given links under each of k gravities (k, 3): (r_j, k) for each joint, N m."""
    robot = data.prepared.model.robot
    tilted = [_with_gravity(robot, acceleration) for acceleration in accelerations]
    bodies = robot.given.of_links
    parts = []
    for motion in data.motions:
        still = np.zeros_like(motion.position)
        torques = [inverse_dynamics(each, bodies, motion.position, still, still) for each in tilted]
        parts.append(motion.rows(np.concatenate(torques, axis=1)))
    n = len(robot.joints)
    return [data.counting(joint, [part[:, joint::n] for part in parts]) for joint in range(n)]


def _with_gravity(robot: RobotModel, gravity: FloatArray) -> RobotModel:
    model = robot.pinocchio.copy()
    model.gravity.linear = gravity
    return replace(robot, pinocchio=model)
