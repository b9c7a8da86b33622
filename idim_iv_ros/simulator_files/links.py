"""From the bodies that joints carry to the links of the URDF.

The model knows one body for each joint: its link, and all that fixed and locked joints carry behind
it. What is fixed keeps the inertials of the URDF and is taken out of that body. Where nothing
possible is left for the link, the change is spread over all of them: one affine map of the whole
body, J → T J Tᵀ, takes the nominal one to the new one and every part of it to a possible part.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from idim_iv_ros.errors import UsageError
from idim_iv_ros.model.mjcf import joint_motion
from idim_iv_ros.model.parameters import body_of, parameters_of
from idim_iv_ros.model.urdf import MOVABLE, Urdf
from idim_iv_ros.physical.pseudo_inertia import inertial_parameters, pseudo_inertia, upper_root
from idim_iv_ros.types import FloatArray

# Of the nominal link the rest must have at least this share in every direction.
_LEAST = 1e-4
_ROUNDING = 1e-12


@dataclass(frozen=True)
class _Part:
    """A link that has mass, in the frame of the joint that carries it."""

    link: str
    place: pin.SE3
    parameters: FloatArray  # XX … M (10,)


def link_bodies(
    urdf: Urdf, joints: Mapping[str, FloatArray], source: str
) -> tuple[dict[str, pin.Inertia], tuple[str, ...]]:
    """Return the links that change, and what there is to say of them.

    `joints`: XX … M (10,) of the body that each identified joint carries; `source` names the URDF
    in messages.

    Raises UsageError: a link for which nothing possible is left.
    """
    carried = _carried(urdf, set(joints))
    changed, notes = {}, []
    for joint, target in joints.items():
        main = urdf.joints[joint].child
        parts = carried[joint]
        others = [part for part in parts if part.link != main]
        main_part = next((part for part in parts if part.link == main), None)
        rest = target - sum((other.parameters for other in others), np.zeros(10))
        reference = rest if main_part is None else main_part.parameters
        if main_part is not None and _same(rest, reference):
            continue
        if is_possible(rest, reference):
            changed[main] = body_of(rest)
            continue
        names = ", ".join(other.link for other in others)
        if not others:
            raise UsageError(f"{source}: link {main}: no body is left for it")
        spread = _spread(parts, target)
        if spread is None:
            raise UsageError(
                f"{source}: link {main}: what is fixed behind it ({names}) weighs more than the "
                f"recording lets {joint} carry, and the nominal inertials are too degenerate to "
                "spread the change; correct their inertials"
            )
        changed |= spread
        notes.append(
            f"{main} and what is fixed behind it ({names}) changed together: with the inertials "
            "that the file gives these, no body would be left for the link"
        )
    return changed, tuple(notes)


def _carried(urdf: Urdf, identified: set[str]) -> dict[str, list[_Part]]:
    """Links with mass that each identified joint carries, their inertials in its frame."""
    places: dict[str, tuple[str, pin.SE3]] = {}
    carried: dict[str, list[_Part]] = {joint: [] for joint in identified}
    for link, joint in urdf.outward():
        carrier, place = ("", pin.SE3.Identity()) if joint is None else places[joint.parent]
        if joint is not None:
            place = place * joint.placement
            if joint.name in identified:
                carrier, place = joint.name, pin.SE3.Identity()
            elif joint.rest != 0.0 and joint.type in MOVABLE:
                place = place * joint_motion(joint.type, joint.axis, joint.rest)
        places[link] = carrier, place
        inertial = urdf.links[link]
        if carrier and inertial is not None and inertial.mass > 0.0:
            body = pin.Inertia(inertial.mass, inertial.centre, inertial.inertia)
            carried[carrier].append(_Part(link, place, parameters_of(place.act(body))))
    return carried


def _same(one: FloatArray, other: FloatArray) -> bool:
    """Whether two bodies differ by no more than rounding."""
    return bool(np.abs(one - other).max() <= _ROUNDING * np.abs(other).max())


def is_possible(parameters: FloatArray, reference: FloatArray) -> bool:
    """Whether a body has these parameters, and no sliver of the reference is left."""
    try:
        root = np.linalg.inv(upper_root(pseudo_inertia(reference)))
    except np.linalg.LinAlgError:
        return bool(np.linalg.eigvalsh(pseudo_inertia(parameters))[0] > 0.0)
    relative = root @ pseudo_inertia(parameters) @ root.T
    return bool(np.linalg.eigvalsh(relative)[0] > _LEAST)


def _spread(parts: list[_Part], target: FloatArray) -> dict[str, pin.Inertia] | None:
    """Map all parts alike; None where the nominal whole is no body."""
    nominal = sum((part.parameters for part in parts), np.zeros(10))
    try:
        root = upper_root(pseudo_inertia(target)) @ np.linalg.inv(
            upper_root(pseudo_inertia(nominal))
        )
    except np.linalg.LinAlgError:
        return None
    mapped = {}
    for part in parts:
        matrix = root @ pseudo_inertia(part.parameters) @ root.T
        mapped[part.link] = part.place.actInv(body_of(inertial_parameters(matrix)))
    return mapped
