"""The nominal model with the causes of a diagnosis, each of which can be left out.

Friction, drive inertia and constant torques are numbers of their joint, a wrong link is that of its
joint, a payload is a separate body. Parameters of a body that the recording does not determine come
from a reference: the nominal link, or a ball of water of the payload's mass. If the determined
numbers belong to no physical body, the nearest one is used, weighted by standard deviations.

A structural effect of friction was found together with a refit of its joint's friction, so that
changes of this friction by no other cause belong to the effect.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pinocchio as pin

from idim_iv_ros.diagnosis.result.causes import Cause
from idim_iv_ros.effects.cause import EffectParameter
from idim_iv_ros.effects.registry import BY_NAME, part_of
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.model import InverseModel
from idim_iv_ros.model.parameters import (
    CENTRE_OF_MASS,
    INERTIAL,
    WHOLE_LINK,
    body_of,
    parameters_of,
    with_centre_moved,
)
from idim_iv_ros.physical import PhysicalParameters, StandardValue
from idim_iv_ros.physical.nearest import TO_INSTALL, nearest_body
from idim_iv_ros.physical.pseudo_inertia import ReferenceLink, pseudo_inertia, upper_root
from idim_iv_ros.physical.remainder import Remainder, spread_remainder
from idim_iv_ros.simulation import SimulatedEffect
from idim_iv_ros.types import FloatArray

_WATER = 1000.0  # kg/m³
_LEAST = 1e-4  # A body must have at least this share of the reference's inertia in every direction
# Torque that bodies and friction would take for theirs.
_NO_BODY = ("torque scale", "gravity")


@dataclass(frozen=True)
class Load:
    """A payload: its body in the frame of the joint that carries it, and its numbers in words."""

    name: str
    joint: str
    parameters: FloatArray  # XX … M (10,)
    words: str

    @property
    def body(self) -> pin.Inertia:
        """Return the body as mass, centre and moments."""
        return body_of(self.parameters)


@dataclass(frozen=True)
class CorrectedModel:
    """Model to export: the nominal model with causes of a diagnosis, or physical parameters."""

    parameters: tuple[StandardValue, ...]
    loads: tuple[Load, ...]  # Payloads as bodies of their own
    effects: tuple[SimulatedEffect, ...]  # Parametric causes that are no parameter of a model
    gravity: FloatArray  # (3,) m/s²
    remainder: Remainder | None = None  # What no cause explains, where `parameters` hold it

    @cached_property
    def values(self) -> dict[str, float]:
        """Return the standard parameters by name."""
        return {parameter.name: parameter.value for parameter in self.parameters}


def kind_of(name: str) -> str:
    """Return the kind of a standard parameter: Fv of Fv2."""
    return name.rstrip("0123456789")


def cause_name(cause: Cause) -> str:
    """Return the name of a cause for the option --without: ``payload@joint_6``."""
    return f"{cause.effect}@{cause.joint}" if cause.joint else cause.effect


def numbers_in_words(parameters: Mapping[str, EffectParameter]) -> str:
    """Return parameters as text, with the half-widths of their 95 % intervals."""
    words = []
    for name, number in parameters.items():
        value = f"{number.value:.4g}"
        if number.std:
            value = f"{_round(number):.6g} ± {1.96 * number.std:.2g}"
        words.append(f"{name.replace('_', ' ')} {value} {number.unit}".strip())
    return ", ".join(words)


def corrected_model(
    model: InverseModel,
    causes: Sequence[Cause],
    left_out: Sequence[Cause],
    physical: PhysicalParameters,
    source: str,
) -> CorrectedModel:
    """Return the nominal model, the given parameters of `model`, with some causes.

    `left_out` are the other causes of the diagnosis; `physical` is of the refit, whose friction
    structural effects of friction need; `source` names the result in messages.

    Raises UsageError: no physical body fits a cause.
    """
    robot, layout = model.robot, model.regressor.layout
    given = dict(zip(layout.names, map(float, layout.vector(robot.given)), strict=True))
    changed: dict[str, tuple[float, float | None]] = {}
    loads: list[Load] = []
    effects: list[SimulatedEffect] = []
    gravity = robot.gravity
    for cause in causes:
        part = part_of(cause.effect)
        if part == "torque scale":
            numbers = {name: _round(parameter) for name, parameter in cause.parameters.items()}
            effects.append(SimulatedEffect(cause.effect, cause.joint, numbers))
        elif part == "gravity":
            present = {name: number.value for name, number in cause.parameters.items()}
            turn = np.array([present.get(f"rotation_about_{axis}", 0.0) for axis in "xyz"])
            gravity = np.asarray(pin.exp3(turn) @ gravity)
            if "gravity_x" in present:  # all of it, where the nominal model's is far from it
                gravity = np.array([present[f"gravity_{axis}"] for axis in "xyz"])
        elif cause.kind == "parametric":
            changes = _changes(cause, robot.joints, given)
            by_kind = {kind_of(name): change for name, change in changes.items()}
            about = f"{source}: {cause_name(cause)}"
            if part == "load" and "M" in by_kind and by_kind["M"].value > 0.0:
                loads.append(_load(cause, by_kind, len(loads), about))
            elif any(kind in INERTIAL for kind in by_kind):
                number = re.sub(r"\D", "", next(iter(changes)))
                nominal = np.array([given[f"{kind}{number}"] for kind in INERTIAL])
                body = _nearest_body(nominal, by_kind, nominal, about)
                for kind, new in zip(INERTIAL, map(float, body), strict=True):
                    shown = kind in by_kind and by_kind[kind].value
                    changed[f"{kind}{number}"] = (new, by_kind[kind].std if shown else None)
            else:
                for name, change in changes.items():
                    value = given[name] + _round(change)
                    changed[name] = (max(value, 0.0) if name[:3] != "off" else value, change.std)
    # Changes of the refit's friction by causes that are left out are removed with them.
    parametric = [cause for cause in left_out if cause.kind == "parametric"]
    others = [_changes(cause, robot.joints, given) for cause in parametric]
    for cause in causes:
        places = [robot.joints.index(j) + 1 for j in (cause.joint, cause.other_joint) if j]
        for name in (f"{kind}{place}" for place in places for kind in ("Fv", "Fc")):
            if cause.kind == "structural" and name in physical.shared:
                gone = sum(other[name].value for other in others if name in other)
                changed[name] = (physical.values[name] - gone, None)
    parameters = tuple(
        StandardValue(
            parameter.name,
            parameter.unit,
            *changed.get(parameter.name, (given[parameter.name], None)),
            given[parameter.name],
            "recording" if parameter.name in changed else "nominal model",
        )
        for parameter in layout.parameters
    )
    return CorrectedModel(parameters, tuple(loads), tuple(effects), gravity)


def with_remainder(
    model: InverseModel,
    causes: Sequence[Cause],
    left_out: Sequence[Cause],
    physical: PhysicalParameters,
    source: str,
) -> CorrectedModel:
    """Return the corrected model with the parameter error spread that no cause explains.

    The remainder is computed with all causes, so that it does not depend on those left out.
    Parameters as for `corrected_model`.
    """
    kept = corrected_model(model, causes, left_out, physical, source)
    for cause in (*causes, *left_out):
        if part_of(cause.effect) in _NO_BODY:
            raise UsageError(
                f"{source}: beside {cause_name(cause)}, which is no number of a body or a joint, "
                "what remains cannot be spread: leave out --remainder"
            )
    names, covariance = list(model.base.names), physical.covariance
    if (
        covariance is None
        or covariance.shape != (len(names), len(names))
        or not np.all(np.isfinite(covariance))
        or [change.name for change in physical.base] != names
    ):
        raise UsageError(
            f"{source}: physical.covariance is not that of the {len(names)} base parameters of "
            "this robot; run `idim-iv diagnose` again"
        )
    whole = corrected_model(model, [*causes, *left_out], [], physical, source)
    joints = model.robot.joints
    try:
        remainder = spread_remainder(
            model.robot,
            model.base,
            np.array([change.estimate for change in physical.base]),
            covariance,
            np.array([parameter.value for parameter in whole.parameters]),
            [(joints.index(load.joint), load.parameters) for load in whole.loads],
            {parameter.name for parameter in whole.parameters if parameter.source == "recording"},
            physical.shared,
        )
    except ImportError as error:
        raise UsageError(TO_INSTALL) from error
    except DataError as error:
        raise UsageError(f"{source}: what remains cannot be spread ({error})") from error
    parameters = tuple(
        parameter
        if parameter.value != other.value or value == parameter.value
        else replace(parameter, value=value, std=None, source="recording and nominal model")
        for parameter, other, value in zip(
            kept.parameters, whole.parameters, map(float, remainder.standard), strict=True
        )
    )
    # The loads of causes that are kept are the first.
    loads = tuple(
        replace(
            load,
            parameters=body,
            words=f"{load.words}; with what no cause explains {body[-1]:.4g} kg",
        )
        for load, body in zip(kept.loads, remainder.loads, strict=False)
    )
    return replace(kept, parameters=parameters, loads=loads, remainder=remainder)


def _changes(
    cause: Cause, joints: Sequence[str], given: Mapping[str, float]
) -> dict[str, EffectParameter]:
    """Return the changes of standard parameters by name that the recording determines."""
    number, changes = joints.index(cause.joint) + 1 if cause.joint else 0, {}
    places = [f"{letters}{number}" for letters in INERTIAL]
    body = np.array([given.get(place, 0.0) for place in places])
    for name, parameter in cause.parameters.items():
        if not parameter.std:
            continue
        kind = BY_NAME[cause.effect].standard_kind(name) if number else ""
        if link := re.fullmatch(r"change_of_(?:base_)?([A-Z]+\d+)", name):
            changes[link[1]] = parameter
        elif kind == WHOLE_LINK or kind in CENTRE_OF_MASS:
            # The link is heavier, or its centre of mass is elsewhere.
            after, further = (
                (1.0 + size) * body
                if kind == WHOLE_LINK
                else with_centre_moved(body, size * np.eye(3)[CENTRE_OF_MASS.index(kind)])
                for size in (parameter.value, parameter.std)
            )
            for place, change, std in zip(places, after - body, further - body, strict=True):
                before = changes.get(place, EffectParameter(0.0, 1e-9, ""))
                std = math.hypot(before.std or 0.0, std)
                changes[place] = EffectParameter(before.value + change, std, "")
            body = after
        elif kind:
            changes[f"{kind}{number}"] = parameter
    return changes


def _load(cause: Cause, numbers: Mapping[str, EffectParameter], others: int, source: str) -> Load:
    mass, none = numbers["M"].value, EffectParameter(0.0, None, "kg m")
    first = np.array([numbers.get(kind, none).value for kind in ("MX", "MY", "MZ")])
    ball = pin.Inertia.FromSphere(mass, (3.0 * mass / (4.0 * math.pi * _WATER)) ** (1.0 / 3.0))
    ball.lever = first / mass
    body = _nearest_body(np.zeros(10), numbers, parameters_of(ball), source)
    words = f"{cause_name(cause)}: {numbers_in_words(cause.parameters)}"
    if not set(INERTIAL) <= set(numbers):
        words += "; the rest as of a ball of water"
    assert cause.joint is not None
    name = f"{cause.effect}_{others + 1}" if others else cause.effect
    return Load(name, cause.joint, body, words)


def _nearest_body(
    start: FloatArray, changes: Mapping[str, EffectParameter], reference: FloatArray, source: str
) -> FloatArray:
    """Return XX … M (10,) of the physical body nearest to `start` with changes by kind."""
    places = [INERTIAL.index(kind) for kind in changes]
    wanted = start.copy()
    wanted[places] += [_round(change) for change in changes.values()]
    if len(places) == len(INERTIAL) and is_possible(wanted, reference):
        return wanted
    std = np.array([change.std for change in changes.values()])
    link = ReferenceLink.of(reference, 1.0, 0.3)
    try:
        return nearest_body(link, places, wanted[places], std)
    except ImportError as error:
        raise UsageError(TO_INSTALL) from error
    except DataError as error:
        raise UsageError(f"{source}: no body has such numbers ({error}); use --refit") from error


def is_possible(parameters: FloatArray, reference: FloatArray) -> bool:
    """Return whether parameters (10,) are of a physical body, and not below 1e-4 of `reference`."""
    try:
        root = np.linalg.inv(upper_root(pseudo_inertia(reference)))
    except np.linalg.LinAlgError:
        return bool(np.linalg.eigvalsh(pseudo_inertia(parameters))[0] > 0.0)
    return bool(np.linalg.eigvalsh(root @ pseudo_inertia(parameters) @ root.T)[0] > _LEAST)


def _round(number: EffectParameter) -> float:
    """Return the value rounded to 0.5 % of its standard deviation."""
    if not number.std:
        return number.value
    return round(number.value, 2 - math.floor(math.log10(number.std)))
