"""What happens between the command and the links: the numbers of every drive of a true robot."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BRISTLES = 4
MOST_JOINTS = 7


class Drive(NamedTuple):
    """Physics of the drives on the joint side; arrays are (n_joints,) unless said.

    A value of zero leaves its effect out, except where a comment says otherwise.
    """

    inertia: FloatArray  # kg m²
    viscous_forward: FloatArray  # N m s/rad, while the speed is positive
    viscous_backward: FloatArray
    dry_forward: FloatArray  # N m
    dry_backward: FloatArray
    offset: FloatArray  # N m
    breakaway: FloatArray  # N m above the dry friction at zero speed
    breakaway_speed: FloatArray  # rad/s, never zero
    breakaway_exponent: FloatArray
    drag: FloatArray  # N m (s/rad)^drag_exponent, may be negative
    drag_exponent: FloatArray
    load: FloatArray  # N m of dry friction at a load of load_scale
    load_scale: FloatArray  # N m, never zero
    load_exponent: FloatArray
    load_direction: FloatArray  # share by which driving and being driven differ
    load_static: FloatArray  # 1: load is gravity and Coriolis torque; 0: torque of the motor
    patch: FloatArray  # share of the dry friction, (n_joints, 2): wave, tight spot
    patch_wave: FloatArray  # rad/rad
    patch_at: FloatArray  # rad, (n_joints, 2)
    patch_width: FloatArray  # rad, never zero
    warm_dry: FloatArray  # share of the dry friction lost when warm
    warm_viscous: FloatArray
    warm_time: FloatArray  # s, never zero
    warm_speed: FloatArray  # rad/s at which the joint ends just warm, never zero
    bristle_travel: FloatArray  # rad; 0: dry friction sticks without travel
    bristle_weight: FloatArray  # (n_joints, BRISTLES), shares of the dry friction
    bristle_span: FloatArray  # (n_joints, BRISTLES), shares of bristle_travel
    stiffness: FloatArray  # N m/rad; 0: motor and link are one
    hardening: FloatArray  # 1/rad²
    damping: FloatArray  # N m s/rad
    gap: FloatArray  # rad between the flanks of the dead zone
    gain: FloatArray  # torque per commanded torque, 1
    delay: FloatArray  # s
    knee: FloatArray  # N m where the torque stops following; infinite: never
    knee_slope: FloatArray  # torque per commanded torque beyond the knee
    ripple: FloatArray  # N m, (n_joints, 2)
    ripple_wave: FloatArray  # rad/rad, (n_joints, 2)
    ripple_phase: FloatArray  # rad, (n_joints, 2)
    spring: FloatArray  # N m/rad around spring_at
    spring_at: FloatArray  # rad
    spring_bend: FloatArray  # rad; > 0 hardens (sinh), < 0 softens (arctan)
    eccentricity: FloatArray  # rad, (n_joints, 2): once and twice a turn
    eccentricity_phase: FloatArray  # rad, (n_joints, 2)
    zero: FloatArray  # rad that the encoder shows where the joint is at zero
    stop: FloatArray  # N m/rad^1.5 of a bumper
    stop_at: FloatArray  # rad
    stop_side: FloatArray  # +1 beyond stop_at, -1 before it
    pair_ratio: FloatArray  # (1,): pair speed = dq_a + ratio dq_b
    pair_dry: FloatArray  # (1,) N m
    pair_viscous: FloatArray  # (1,) N m (s/rad)^pair_exponent
    pair_exponent: FloatArray  # (1,)
    pair: NDArray[np.int64]  # (2,) joints a and b


def rigid_drive(
    inertia: FloatArray, viscous: FloatArray, dry: FloatArray, offset: FloatArray
) -> Drive:
    """Drives that have inertia, viscous and dry friction and an offset, and nothing else."""
    n = len(inertia)
    zero, one = np.zeros(n), np.ones(n)
    nothing = {name: zero.copy() for name in Drive._fields}
    for name in (
        "breakaway_speed",
        "breakaway_exponent",
        "drag_exponent",
        "load_scale",
        "load_exponent",
        "patch_width",
        "warm_time",
        "warm_speed",
        "gain",
        "spring_bend",
        "stop_side",
    ):
        nothing[name] = one.copy()
    for name in ("patch", "patch_at", "ripple", "ripple_wave", "ripple_phase"):
        nothing[name] = np.zeros((n, 2))
    nothing["eccentricity"], nothing["eccentricity_phase"] = np.zeros((2, n, 2))
    nothing["bristle_weight"] = np.full((n, BRISTLES), 1.0 / BRISTLES)
    nothing["bristle_span"] = np.ones((n, BRISTLES))
    nothing["knee"] = np.full(n, np.inf)
    for name in ("pair_ratio", "pair_dry", "pair_viscous", "pair_exponent"):
        nothing[name] = np.ones(1) if name == "pair_exponent" else np.zeros(1)
    rigid = {
        "inertia": inertia,
        "viscous_forward": viscous,
        "viscous_backward": viscous.copy(),
        "dry_forward": dry,
        "dry_backward": dry.copy(),
        "offset": offset,
        "pair": np.zeros(2, dtype=np.int64),
    }
    return Drive(**{**nothing, **rigid})


def packed(drive: Drive) -> np.void:
    """The drives as one record for compiled code, which reads it as it would read the tuple.

    A tuple of sixty arrays is copied, and its references counted, at every call: with the record
    a step takes a sixth of the time.
    """
    values = {
        name: value if name.startswith("pair") else _padded(value)
        for name, value in drive._asdict().items()
    }
    kind = np.dtype([(name, value.dtype, value.shape) for name, value in values.items()])
    record = np.zeros(1, kind)[0]
    for name, value in values.items():
        record[name] = value
    return record


def _padded(values: FloatArray) -> FloatArray:
    """Values (MOST_JOINTS, …) with zeros for joints that are not there.

    All records then have one type. numba names compiled code after types by numbers that another
    process gives otherwise: of two types the cached code of one would be run with the other.
    """
    padded = np.zeros((MOST_JOINTS, *values.shape[1:]))
    padded[: len(values)] = values
    return padded


def altered(drive: Drive, joint: int, **values: float | FloatArray) -> Drive:
    """A copy with other values at one joint.

    Raises
    ------
    ValueError
        A name that drives do not have.
    """
    changed = {}
    for name, value in values.items():
        if name not in Drive._fields:
            raise ValueError(f"drives have no {name}")
        array = getattr(drive, name).copy()
        array[joint] = value
        changed[name] = array
    return drive._replace(**changed)
