"""Standard dynamic parameters: names, units and order (paper, section II.B)."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
import pinocchio as pin

from idim_iv_ros.types import FloatArray, IntArray

JointType = Literal["revolute", "prismatic"]
EffortUnit = Literal["N m", "A", "V"]
# Units of the drives' parameters at a revolute joint.
_OF_DRIVES = {"Ia": "kg m²", "Fv": "N m s/rad", "Fc": "N m", "off": "N m"}

INERTIAL = ("XX", "XY", "XZ", "YY", "YZ", "ZZ", "MX", "MY", "MZ", "M")
POINT = ("M", "MX", "MY", "MZ")  # of a mass without size
WHOLE_LINK = "link"  # all of INERTIAL in proportion
CENTRE_OF_MASS = ("centre x", "centre y", "centre z")  # mass and moments about it stay
# Where each of INERTIAL is in (M, MX, MY, MZ, XX, XY, YY, XZ, YZ, ZZ), the order of
# pinocchio's regressor and of DynamicParameters.inertial.
REGRESSOR_ORDER = (4, 5, 7, 6, 8, 9, 1, 2, 3, 0)


def body_of(parameters: FloatArray) -> pin.Inertia:
    """Mass, centre and inertia of XX … M (10,) about the origin of a frame, in its axes."""
    return pin.Inertia.FromDynamicParameters(parameters[np.argsort(REGRESSOR_ORDER)])


def parameters_of(body: pin.Inertia) -> FloatArray:
    """XX … M (10,) of a body about the origin of its frame."""
    return np.asarray(body.toDynamicParameters()[list(REGRESSOR_ORDER)])


def with_centre_moved(parameters: FloatArray, shift: FloatArray) -> FloatArray:
    """XX … M (10,) of a body whose centre of mass is moved (3,), m, and turned by nothing."""
    first, mass = parameters[6:9], parameters[9]
    moved = parameters.copy()
    moved[6:9] += mass * shift
    crossed = np.outer(first, shift) + np.outer(shift, first) + mass * np.outer(shift, shift)
    moved[:6] += (np.trace(crossed) * np.eye(3) - crossed)[np.triu_indices(3)]
    return moved


_WORDS = {
    "M": "link mass",
    "Ia": "drive inertia",
    "Fv": "viscous friction",
    "Fc": "Coulomb friction",
    "off": "torque offset",
    "Fvm": "viscous friction of the coupling",
    "Fcm": "Coulomb friction of the coupling",
}


def words_of_name(name: str, joints: Sequence[str]) -> str:
    """Say what a parameter is: “Coulomb friction at joint_3” for ``Fc3``."""
    parts = re.fullmatch(r"([A-Za-z]+)(\d+)", name)
    if parts is None or not 1 <= int(parts[2]) <= len(joints):
        return name
    kind = parts[1]
    moved = f"first moment {kind[1:].lower()}" if kind in POINT else f"inertia {kind.lower()}"
    return f"{_WORDS.get(kind) or f'link {moved}'} at {joints[int(parts[2]) - 1]}"


def unit_at(unit: str, joint_type: str, effort_unit: str = "N m") -> str:
    """Return a unit as it is at a joint, also within words.

    - `unit`: as it is at a revolute joint whose effort is a torque in N m: ``rad``, ``mrad/s``,
      ``N m s/rad``, ``kg m²``
    - `effort_unit`: ``N m``, or ``A`` or ``V`` where the effort is a motor current or voltage
    """
    slides = joint_type == "prismatic"
    if effort_unit != "N m":
        unit = unit.replace("kg m²", f"{effort_unit} s²/rad").replace("N m", effort_unit)
    elif slides:
        unit = unit.replace("kg m²", "kg").replace("N m", "N")
    return re.sub(r"\b(m?)rad\b", r"\1m", unit) if slides else unit


@dataclass(frozen=True)
class StandardParameter:
    """One parameter of one link or drive."""

    name: str  # As in the paper, link index from 1: ``ZZ1``, ``Ia1``, ``Fcm6``
    kind: str  # The name without its index
    joint: int  # Index of the link or drive, from 0
    unit: str


@dataclass(frozen=True)
class DynamicParameters:
    """Numerical values of the standard parameters, shaped for dynamics computations.

    The model is linear in all of them, so that the values need not be physical: a base
    parameter vector is written here as it is, with the eliminated parameters at zero.
    """

    # (n_joints, 10): M, MX, MY, MZ, XX, XY, YY, XZ, YZ, ZZ of each link, about the origin of its
    # joint frame, kg, kg m, kg m²
    inertial: FloatArray
    drive_inertia: FloatArray  # (n_joints,): joint side, kg m² (kg)
    viscous: FloatArray  # (n_joints,): N m s/rad (N s/m)
    coulomb: FloatArray  # (n_joints,): N m (N)
    offset: FloatArray  # (n_joints,): N m (N)
    coupling_joints: IntArray  # (n_couplings, 2): joints (a, b) that a transmission couples
    # (n_couplings,) each: Iam, Fvm, Fcm: torque on a: Iam ddq_b + Fvm dq_b + Fcm sign(dq_a + dq_b);
    # on b: Iam ddq_a + Fvm dq_a + Fcm sign(dq_a + dq_b). The motor of b turns with both joints, so
    # that Iam is its drive inertia Ia_b, and what it adds to the diagonal of a belongs to Ia_a.
    coupling_inertia: FloatArray
    coupling_viscous: FloatArray
    coupling_coulomb: FloatArray

    @classmethod
    def zero(cls, joints: int, couplings: Sequence[tuple[int, int]]) -> "DynamicParameters":
        """Parameters of zero for so many joints, of which these pairs are coupled."""
        pairs = np.array(couplings, dtype=np.int64).reshape(-1, 2)
        drive_inertia, viscous, coulomb, offset = np.zeros((4, joints))
        inertial, of_couplings = np.zeros((joints, 10)), np.zeros((3, len(pairs)))
        return cls(inertial, drive_inertia, viscous, coulomb, offset, pairs, *of_couplings)

    @property
    def of_bodies(self) -> FloatArray:
        """Inertial parameters XX … M of all links in the order of the regressor, (n_joints, 10)."""
        return np.asarray(self.inertial[:, list(REGRESSOR_ORDER)])

    @property
    def of_links(self) -> "DynamicParameters":
        """The rigid bodies alone: without drives, friction and offsets."""
        return self.without_friction._without("drive_inertia", "coupling_inertia")

    @property
    def without_friction(self) -> "DynamicParameters":
        """These parameters without friction and offsets."""
        return self._without("viscous", "coulomb", "offset", "coupling_viscous", "coupling_coulomb")

    @property
    def without_dry_friction(self) -> "DynamicParameters":
        """These parameters without dry friction, but that of couplings."""
        return self._without("coulomb")

    def _without(self, *terms: str) -> "DynamicParameters":
        return replace(self, **{term: np.zeros_like(getattr(self, term)) for term in terms})

    @property
    def of_drives(self) -> dict[str, FloatArray]:
        """Inertia, friction and offset (n_joints,) of the drives by the names of parameters."""
        values = (self.drive_inertia, self.viscous, self.coulomb, self.offset)
        return dict(zip(_OF_DRIVES, values, strict=True))

    def value_of(self, parameter: StandardParameter) -> FloatArray | None:
        """A view () of the value of a standard parameter; None of a coupling that is not here."""
        if parameter.kind in INERTIAL:
            column = REGRESSOR_ORDER[INERTIAL.index(parameter.kind)]
            return self.inertial[parameter.joint, column : column + 1].reshape(())
        places, values = [parameter.joint], self.of_drives.get(parameter.kind)
        if values is None:
            couplings = {"Fvm": self.coupling_viscous, "Fcm": self.coupling_coulomb}
            values = couplings[parameter.kind]
            places = np.flatnonzero(self.coupling_joints[:, 1] == parameter.joint).tolist()
        return values[places[0] : places[0] + 1].reshape(()) if places else None


@dataclass(frozen=True)
class ParameterLayout:
    """Which standard parameters a model has, and in which order they are in a vector.

    Order: link 1 (XX … M, Ia, Fv, Fc, off), link 2, …, then Fvm, Fcm of each coupling. A coupling
    has no inertia of its own: Ia_b of its second joint acts on ddq_a + ddq_b.
    """

    parameters: tuple[StandardParameter, ...]
    joints: int
    coupling_joints: tuple[tuple[int, int], ...]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all standard parameters, in order."""
        return tuple(parameter.name for parameter in self.parameters)

    @cached_property
    def of_bodies(self) -> IntArray:
        """Places (n_joints, 10) of XX … M of each link in a vector of this layout."""
        places = [k for k, parameter in enumerate(self.parameters) if parameter.kind in INERTIAL]
        return np.array(places).reshape(-1, len(INERTIAL))

    def vector(self, values: DynamicParameters) -> FloatArray:
        """Write values into a vector (n_standard,) of this layout; other terms are left out."""
        given = [values.value_of(parameter) for parameter in self.parameters]
        return np.array([0.0 if value is None else float(value) for value in given])

    def dynamic_parameters(self, vector: FloatArray) -> DynamicParameters:
        """Shape a vector (n_standard,) for dynamics; terms outside the layout are zero."""
        values = DynamicParameters.zero(self.joints, self.coupling_joints)
        for number, parameter in zip(vector, self.parameters, strict=True):
            place = values.value_of(parameter)
            assert place is not None
            place[...] = number
        values.coupling_inertia[:] = values.drive_inertia[values.coupling_joints[:, 1]]
        return values


def parameter_layout(
    joint_types: Sequence[JointType],
    *,
    friction: Sequence[str],
    drive_inertia: bool,
    couplings: Sequence[tuple[int, int]] = (),
    effort_unit: EffortUnit = "N m",
) -> ParameterLayout:
    """List the standard parameters of a robot.

    - `friction`: any of ``viscous``, ``coulomb``, ``offset``
    - `couplings`: pairs of joint indices (a, b) coupled by a transmission; named by b
    - `effort_unit`: unit of the torque side of the model; with ``A`` or ``V`` all units follow
    """
    present = {"Ia": drive_inertia, "Fv": "viscous" in friction, "Fc": "coulomb" in friction}
    present["off"] = "offset" in friction
    of_drives = [kind for kind in _OF_DRIVES if present[kind]]
    listed = [
        (kind, joint) for joint in range(len(joint_types)) for kind in (*INERTIAL, *of_drives)
    ]
    listed += [(f"{k}m", joint) for _, joint in couplings for k in ("Fv", "Fc") if present[k]]
    parameters = tuple(
        StandardParameter(
            f"{kind}{joint + 1}", kind, joint, _unit(kind, joint_types[joint], effort_unit)
        )
        for kind, joint in listed
    )
    return ParameterLayout(parameters, len(joint_types), tuple(couplings))


def _unit(kind: str, joint_type: JointType, effort_unit: EffortUnit) -> str:
    if kind not in INERTIAL:
        return unit_at(_OF_DRIVES[kind.removesuffix("m")], joint_type, effort_unit)
    if effort_unit == "N m":
        return {"M": "kg", "MX": "kg m", "MY": "kg m", "MZ": "kg m"}.get(kind, "kg m²")
    revolute = joint_type == "revolute"
    length = {"M": "/m²", "MX": "/m", "MY": "/m", "MZ": "/m"} if revolute else {"M": "/m"}
    return f"{effort_unit} s²{length.get(kind, '')}"
