"""Regressor of the inverse dynamic model (paper, equation 3), its inertial columns compiled.

Row j of the block of link i is the torque that joint j needs for the wrenches of link i: those of
each inertial parameter, turned to the axis of joint j as link i sees it.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from idim_iv_ros.compilation import entry, kernel, source_digest
from idim_iv_ros.model import link_motion
from idim_iv_ros.model.link_motion import LinkFrames, LinkMotion, Vector, turn
from idim_iv_ros.model.parameters import REGRESSOR_ORDER, ParameterLayout
from idim_iv_ros.model.robot import RobotModel
from idim_iv_ros.types import FloatArray, IntArray


@kernel
def ascend(rot: FloatArray, p: FloatArray, pose: FloatArray) -> None:
    """Pose (3, 4) of a link, rotation and origin, from the frame of one joint to its parent's."""
    for c in range(4):
        x, y, z = turn(rot, pose[0, c], pose[1, c], pose[2, c])
        pose[0, c], pose[1, c], pose[2, c] = x, y, z
    for r in range(3):
        pose[r, 3] += p[r]


@kernel
def joint_row(
    axis: Vector, slide: Vector, a: Vector, w: Vector, d: Vector, row: FloatArray
) -> None:
    """Torque of one joint for each of M, MX, MY, MZ, XX, XY, YY, XZ, YZ, ZZ of one link.

    In the link's frame: rotation about `axis` and velocity `slide` of its origin for unit speed of
    the joint, acceleration `a` of the origin, spin `w` and its rate `d`.
    """
    u0, u1, u2 = axis
    v0, v1, v2 = slide
    a0, a1, a2 = a
    w0, w1, w2 = w
    d0, d1, d2 = d
    row[0] = v0 * a0 + v1 * a1 + v2 * a2
    row[1] = v1 * (w0 * w1 + d2) + v2 * (w0 * w2 - d1) - v0 * (w1 * w1 + w2 * w2)
    row[2] = v0 * (w0 * w1 - d2) + v2 * (w1 * w2 + d0) - v1 * (w0 * w0 + w2 * w2)
    row[3] = v0 * (w0 * w2 + d1) + v1 * (w1 * w2 - d0) - v2 * (w0 * w0 + w1 * w1)
    row[1] += u2 * a1 - u1 * a2
    row[2] += u0 * a2 - u2 * a0
    row[3] += u1 * a0 - u0 * a1
    row[4] = u0 * d0 + u1 * w0 * w2 - u2 * w0 * w1
    row[5] = u0 * (d1 - w0 * w2) + u1 * (d0 + w1 * w2) + u2 * (w0 * w0 - w1 * w1)
    row[6] = u1 * d1 - u0 * w1 * w2 + u2 * w0 * w1
    row[7] = u0 * (d2 + w0 * w1) + u1 * (w2 * w2 - w0 * w0) + u2 * (d0 - w1 * w2)
    row[8] = u0 * (w1 * w1 - w2 * w2) + u1 * (d2 - w0 * w1) + u2 * (d1 + w0 * w2)
    row[9] = u0 * w1 * w2 - u1 * w0 * w2 + u2 * d2


def _entry(digest: str) -> Any:
    """Compile the function that Python calls; `digest` is part of its key in numba's cache."""

    @entry
    def columns(
        frames: LinkFrames,
        q: FloatArray,
        dq: FloatArray,
        ddq: FloatArray,
        motion: LinkMotion,
        pose: FloatArray,
        row: FloatArray,
        place: IntArray,
        rows: IntArray,
        matrix: FloatArray,
    ) -> None:
        """Fill the columns of inertial parameters in `matrix` (samples, n, n_standard) of zeros.

        `q`, `dq`, `ddq`: (samples, n), joints in tree order; `place` (n, 10), `rows` (n,): columns
        of the links' parameters, rows of the joints; `motion`, `pose` (3, 4), `row` (10,): written.
        """
        _ = digest
        samples, n = q.shape
        for sample in range(samples):
            link_motion.place_links(frames, q[sample], motion)
            link_motion.move_links(frames, dq[sample], ddq[sample], motion)
            for i in range(1, n + 1):
                turned = frames.turned[i]
                a, w, d = motion.acceleration[i], motion.spin[i], motion.spin_rate[i]
                acceleration = turn(turned, a[0], a[1], a[2])
                spin = turn(turned, w[0], w[1], w[2])
                rate = turn(turned, d[0], d[1], d[2])
                for r in range(3):
                    for c in range(4):
                        pose[r, c] = 1.0 if r == c else 0.0
                j = i
                while j > 0:
                    # The axis of joint j is z of its frame: the third row of the rotation.
                    axis = turn(turned, pose[2, 0], pose[2, 1], pose[2, 2])
                    if frames.revolute[j]:
                        slide = turn(turned, *turn(pose.T, -pose[1, 3], pose[0, 3], 0.0))
                    else:
                        axis, slide = (0.0, 0.0, 0.0), axis
                    joint_row(axis, slide, acceleration, spin, rate, row)
                    for k in range(10):
                        matrix[sample, rows[j - 1], place[i - 1, k]] = row[k]
                    ascend(motion.rotation[j], motion.translation[j], pose)
                    j = frames.parent[j]

    return columns


inertial_columns = _entry(source_digest(link_motion))


@dataclass(frozen=True)
class StandardRegressor:
    """Matrix of basis functions of the standard parameters: τ = IDM(q, dq, ddq) β."""

    robot: RobotModel
    layout: ParameterLayout  # Columns of the matrix

    def __call__(
        self, q: FloatArray, dq: FloatArray, ddq: FloatArray, smooth: FloatArray | None = None
    ) -> FloatArray:
        """Evaluate at states `q`, `dq`, `ddq` (n_samples, n_joints) rad, rad/s, rad/s² (m, …).

        `smooth` (n_joints,): speeds below which the sign of dry friction is smoothed; None: sharp.
        Returns (n_samples, n_joints, n_standard).
        """
        samples, joints = q.shape
        matrix = np.zeros((samples, joints, len(self.layout.parameters)))
        order = self.robot.order
        motion = (np.ascontiguousarray(values[:, order], dtype=float) for values in (q, dq, ddq))
        inertial_columns(
            self._frames,
            *motion,
            link_motion.empty_motion(joints),
            np.empty((3, 4)),
            np.empty(10),
            self._inertial_places,
            order,
            matrix,
        )
        self._drives(matrix, dq, ddq, smooth)
        return matrix

    @cached_property
    def _frames(self) -> LinkFrames:
        return link_motion.link_frames(self.robot)

    @cached_property
    def _inertial_places(self) -> IntArray:
        """Columns (n_joints, 10) of the inertial parameters, links in tree order."""
        columns = self.layout.of_bodies[self.robot.order]
        return np.ascontiguousarray(columns[:, np.argsort(REGRESSOR_ORDER)])

    def _drives(
        self, matrix: FloatArray, dq: FloatArray, ddq: FloatArray, smooth: FloatArray | None
    ) -> None:
        """Fill in the columns of drives, friction and offsets."""

        def sign(speed: FloatArray, joint: int) -> FloatArray:
            return np.asarray(np.sign(speed) if smooth is None else np.tanh(speed / smooth[joint]))

        pairs = {pair[1]: pair[0] for pair in self.layout.coupling_joints}
        signals = {"Ia": ddq, "Fv": dq, "off": np.ones_like(dq)}
        for column, parameter in enumerate(self.layout.parameters):
            joint, kind = parameter.joint, parameter.kind
            if kind in signals:
                matrix[:, joint, column] = signals[kind][:, joint]
            if kind == "Ia" and joint in pairs:
                matrix[:, joint, column] += ddq[:, pairs[joint]]
                matrix[:, pairs[joint], column] = ddq[:, joint]
            elif kind == "Fc":
                matrix[:, joint, column] = sign(dq[:, joint], joint)
            elif kind == "Fvm":
                matrix[:, pairs[joint], column] = dq[:, joint]
                matrix[:, joint, column] = dq[:, pairs[joint]]
            elif kind == "Fcm":
                coupled = sign(dq[:, pairs[joint]] + dq[:, joint], joint)
                matrix[:, pairs[joint], column] = matrix[:, joint, column] = coupled
