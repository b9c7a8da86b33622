"""What an MJCF holds beyond a tree of hinges and slides: joints that are tied, other forces."""

from collections import defaultdict
from typing import Any

import numpy as np

# Effects that an exported MJCF holds as elements of its own. A tuple of `custom` by this name lists
# the joints or tendons: they are no part of the nominal model, and `notes` says so.
DAMPING, SPRING, COUPLING = "nonlinear_viscous", "spring", "joint_coupling"


def native_elements(mujoco: Any, model: Any) -> dict[str, list[int]]:
    """Joints (for a coupling: tendons) whose elements are effects of an export, by effect."""
    elements: dict[str, list[int]] = {}
    for effect, kind in (
        (DAMPING, mujoco.mjtObj.mjOBJ_JOINT),
        (SPRING, mujoco.mjtObj.mjOBJ_JOINT),
        (COUPLING, mujoco.mjtObj.mjOBJ_TENDON),
    ):
        index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TUPLE, effect)
        if index < 0:
            continue
        first = int(model.tuple_adr[index])
        places = range(first, first + int(model.tuple_size[index]))
        elements[effect] = [
            int(model.tuple_objid[place]) for place in places if model.tuple_objtype[place] == kind
        ]
    return elements


def tied_joints(mujoco: Any, model: Any) -> dict[int, str]:
    """Free and ball joints, and joints that something ties, by number: what it is, in words."""
    reasons: dict[int, list[str]] = defaultdict(list)
    types = mujoco.mjtJoint
    kinds = {types.mjJNT_FREE: "a free joint", types.mjJNT_BALL: "a ball joint"}
    for joint in range(model.njnt):
        if (words := kinds.get(types(model.jnt_type[joint]))) is not None:
            reasons[joint].append(words)
    for equality in np.flatnonzero(model.eq_active0).tolist():
        words = f"tied by the equality {model.equality(equality).name}".strip()
        for joint in _of_equality(mujoco, model, equality):
            reasons[joint].append(words)
    effects = native_elements(mujoco, model).get(COUPLING, [])
    for tendon in range(model.ntendon):
        if tendon not in effects and _acts(mujoco, model, tendon):
            words = f"driven by the tendon {model.tendon(tendon).name}".strip()
            for joint in _of_tendon(mujoco, model, tendon):
                reasons[joint].append(words)
    return {joint: " and ".join(dict.fromkeys(words)) for joint, words in reasons.items()}


def _of_equality(mujoco: Any, model: Any, equality: int) -> set[int]:
    """Joints that an equality ties to each other or to the world."""
    kind, kinds = model.eq_type[equality], mujoco.mjtEq
    first, second = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
    if kind == kinds.mjEQ_JOINT:
        return {joint for joint in (first, second) if joint >= 0}
    if kind == kinds.mjEQ_TENDON:
        both = (tendon for tendon in (first, second) if tendon >= 0)
        return set().union(*(_of_tendon(mujoco, model, tendon) for tendon in both))
    if kind == kinds.mjEQ_CONNECT or kind == kinds.mjEQ_WELD:
        if model.eq_objtype[equality] == mujoco.mjtObj.mjOBJ_SITE:
            first, second = int(model.site_bodyid[first]), int(model.site_bodyid[second])
        return _between(model, [first, second])
    return set()


def _acts(mujoco: Any, model: Any, tendon: int) -> bool:
    """Whether a tendon does more than to measure a length."""
    numbers = (model.tendon_stiffness, model.tendon_damping, model.tendon_frictionloss)
    armature = getattr(model, "tendon_armature", np.zeros(model.ntendon))
    driven = (model.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON) & (
        model.actuator_trnid[:, 0] == tendon
    )
    return bool(
        any(float(number[tendon]) != 0.0 for number in (*numbers, armature))
        or model.tendon_limited[tendon]
        or np.any(driven)
    )


def _of_tendon(mujoco: Any, model: Any, tendon: int) -> set[int]:
    """Joints that a tendon pulls: those it wraps, and those between the bodies of its sites."""
    joints: set[int] = set()
    bodies = []
    first = int(model.tendon_adr[tendon])
    for wrap in range(first, first + int(model.tendon_num[tendon])):
        kind, index = model.wrap_type[wrap], int(model.wrap_objid[wrap])
        if kind == mujoco.mjtWrap.mjWRAP_JOINT:
            joints.add(index)
        elif kind == mujoco.mjtWrap.mjWRAP_SITE:
            bodies.append(int(model.site_bodyid[index]))
    return joints | _between(model, bodies)


def _between(model: Any, bodies: list[int]) -> set[int]:
    """Joints on the paths between bodies: those that do not carry all of them."""
    carriers: list[set[int]] = []
    for body in bodies:
        carriers.append(set())
        while body > 0:
            first = int(model.body_jntadr[body])
            carriers[-1].update(range(first, first + int(model.body_jntnum[body])))
            body = int(model.body_parentid[body])
    joints: set[int] = set()
    return joints.union(*carriers) - carriers[0].intersection(*carriers) if carriers else joints


def extra_forces(mujoco: Any, model: Any) -> dict[int, str]:
    """Say of joints what acts on them that the nominal model has no term for."""
    forces: dict[int, list[str]] = {}
    effects = native_elements(mujoco, model)
    for joint in range(model.njnt):
        dof, words = int(model.jnt_dofadr[joint]), []
        sprung = model.jnt_stiffness[joint] or np.any(_poly(model, "jnt_stiffnesspoly", joint))
        if sprung and joint not in effects.get(SPRING, []):
            words.append("a spring (stiffness)")
        curved = np.any(_poly(model, "dof_dampingpoly", dof))
        if curved and joint not in effects.get(DAMPING, []):
            words.append("nonlinear damping")
        if words:
            forces[joint] = words
    special = getattr(mujoco.mjtGain, "mjGAIN_DCMOTOR", -1)
    at_joints = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
    for actuator in np.flatnonzero(at_joints & (model.actuator_gaintype == special)):
        forces.setdefault(int(model.actuator_trnid[actuator, 0]), []).append("a dcmotor")
    return {joint: " and ".join(words) for joint, words in forces.items()}


def _poly(model: Any, name: str, index: int) -> Any:
    """Coefficients beyond the first; zero where this version of MuJoCo has none."""
    values = getattr(model, name, None)
    return 0.0 if values is None else values[index]


def notes(mujoco: Any, model: Any) -> list[str]:
    """Sentences on what the file has and the nominal model leaves out (effects, contacts)."""
    sentences = []
    for effect, elements in native_elements(mujoco, model).items():
        one = model.tendon if effect == COUPLING else model.joint
        listed = ", ".join(one(index).name for index in elements)
        sentences.append(
            f"{effect} of {listed}, which an export put there, is an effect and no part of the "
            "nominal model"
        )
    compensated = [model.body(b).name for b in range(model.nbody) if model.body_gravcomp[b] != 0.0]
    if compensated:
        listed = ", ".join(name or "an unnamed body" for name in compensated)
        sentences.append(
            f"gravcomp of {listed} is passed over: the nominal model feels all gravity"
        )
    if model.opt.density > 0.0 or model.opt.viscosity > 0.0:
        sentences.append("density and viscosity of the medium are passed over")
    return sentences
