"""All servos of a robot at once: Gauss-Newton on the simulated motion of its coupled joints."""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.model.robot import RobotModel
from idim_iv_ros.servo.fit import PARAMETERS, DriveEstimate, block_covariance, block_labels
from idim_iv_ros.servo.loop_kernel import Drive
from idim_iv_ros.servo.rigid_load import Motion, RigidLoad
from idim_iv_ros.types import FloatArray

_ITERATIONS, _HALVINGS = 6, 3
_ENOUGH = 1e-3  # share by which the cost must fall for another iteration
_DIFFERENCE = 0.2  # standard deviations


def fit_robot(
    motions: Sequence[Motion],
    loads: Sequence[RigidLoad],
    robot: RobotModel,
    estimates: Sequence[DriveEstimate],
) -> tuple[list[DriveEstimate], list[RigidLoad]]:
    """Improve estimates that were made joint by joint.

    Sensitivities are taken once; the rigid bodies' torques are taken again along the motion of
    every iteration. Joints are weighted by their residuals.

    Returns
    -------
    estimates, loads
        Loads along the last simulated motion.
    """
    drives = np.array([estimate.drive for estimate in estimates])
    spread = np.sqrt([np.diag(estimate.covariance) for estimate in estimates])
    places = np.argwhere(spread > 0.0)
    low = np.array([-np.inf if PARAMETERS[k] == "offset" else 0.0 for _, k in places])
    current = list(loads)
    residual = _residual(motions, current, drives)
    weights = _weights(motions, residual)
    columns = []
    for joint, k in places:
        step = _DIFFERENCE * spread[joint, k]
        moved = drives.copy()
        moved[joint, k] += step
        columns.append((residual - _residual(motions, current, moved)) / step)
    slopes = np.column_stack(columns)
    cost = float(residual @ (weights * residual))
    for _ in range(_ITERATIONS):
        weighted = slopes * weights[:, None]
        change = np.linalg.lstsq(weighted.T @ slopes, weighted.T @ residual, rcond=1e-12)[0]
        for halving in range(_HALVINGS):
            trial = drives.copy()
            values = drives[tuple(places.T)] + change * 0.5**halving
            trial[tuple(places.T)] = np.maximum(values, low)
            simulated = [
                load.simulated(trial, motion) for load, motion in zip(current, motions, strict=True)
            ]
            if not np.isfinite(np.concatenate(simulated, axis=1)).all():
                continue
            along = [
                RigidLoad.along(motion.robot or robot, trajectory)
                for motion, trajectory in zip(motions, simulated, strict=True)
            ]
            left = _residual(motions, along, trial)
            if float(left @ (weights * left)) < cost:
                break
        else:
            break
        fallen = 1.0 - float(left @ (weights * left)) / cost
        # Broyden: what the step showed of the sensitivities.
        taken = trial[tuple(places.T)] - drives[tuple(places.T)]
        scaled = taken / spread[tuple(places.T)]
        missed = (residual - left) - slopes @ taken
        slopes = slopes + np.outer(missed, scaled / spread[tuple(places.T)]) / (scaled @ scaled)
        drives, current, residual = trial, along, left
        cost *= 1.0 - fallen
        if fallen < _ENOUGH:
            break
    weights = _weights(motions, residual)
    root = np.sqrt(weights)
    labels = np.concatenate(
        [
            np.repeat(label[:, None], drives.shape[0], axis=1)[motion.used]
            for label, motion in zip(block_labels(motions), motions, strict=True)
        ]
    )
    covariance, blocks = block_covariance(labels, root * residual, root[:, None] * slopes)
    owner = np.concatenate([np.argwhere(motion.used)[:, 1] for motion in motions])
    improved = []
    for joint in range(len(drives)):
        mine = places[:, 0] == joint
        whole = np.zeros((len(PARAMETERS), len(PARAMETERS)))
        whole[np.ix_(places[mine, 1], places[mine, 1])] = covariance[np.ix_(mine, mine)]
        rms = float(np.sqrt(np.mean(residual[owner == joint] ** 2)))
        improved.append(DriveEstimate(Drive(*drives[joint]), whole, rms, blocks))
    return improved, current


def _residual(
    motions: Sequence[Motion], loads: Sequence[RigidLoad], drives: FloatArray
) -> FloatArray:
    """Measured less simulated positions of all joints where they are compared, (n,) rad."""
    parts = []
    for motion, load in zip(motions, loads, strict=True):
        simulated = load.simulated(drives, motion)[0, :: motion.finer]
        parts.append((motion.position - simulated)[motion.used])
    return np.concatenate(parts)


def _weights(motions: Sequence[Motion], residual: FloatArray) -> FloatArray:
    """One over the mean square of the residuals of a value's joint, (n,)."""
    owner = np.concatenate([np.argwhere(motion.used)[:, 1] for motion in motions])
    square = np.bincount(owner, residual**2) / np.maximum(np.bincount(owner), 1)
    return np.asarray(1.0 / np.maximum(square[owner], 1e-18))
