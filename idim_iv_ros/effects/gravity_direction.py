"""A robot that is mounted at another angle than the nominal model says."""

import numpy as np

from idim_iv_ros.effects.cause import ParameterSpec
from idim_iv_ros.effects.parametric_effect import Change, ParameterSpace, ParametricEffect


class GravityDirection(ParametricEffect):
    """Small rotation of gravity about two axes of the base frame that are level."""

    name = "gravity_direction"
    order = 20
    part = "gravity"
    largest = 0.6  # rad: beyond it the small rotation that is assumed is none
    excitation = "slow motion through the whole range of all joints"
    segments = ("range_sweep",)
    specs = tuple(
        ParameterSpec(
            f"rotation_about_{axis}", "rad", f"rotation of gravity about {axis} of the base"
        )
        for axis in "xyz"
    )

    def places(self, space: ParameterSpace) -> list[int | None]:
        """No joint: gravity acts on the whole robot."""
        return [None]

    def variants(self, space: ParameterSpace, joint: int | None) -> list[list[Change]]:
        """The two angles by which gravity may be tilted, together."""
        axes = ["xyz"[int(np.argmax(np.abs(axis)))] for axis in space.axes]
        return [
            [Change(f"rotation_about_{axis}", "rad", space.tilt(k)) for k, axis in enumerate(axes)]
        ]
