"""Dry friction that sticks: which contacts hold and with what torque (compiled).

A *contact* opposes one slip speed with a torque up to its level: contact c < n_joints that of
joint c, the others the sum or difference of two joints' speeds (couplings). It slips (mode is the
sign of its speed) or is stuck (mode 0, speed exactly zero). Contacts without friction are left out.
"""

import math

from idim_iv_ros.compilation import kernel
from idim_iv_ros.simulation.plant import Contacts, Plant, Workspace
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

# A constraint whose pivot is this small beside its diagonal follows from the others.
DEPENDENT = 1e-10


@kernel
def copy(source: FloatArray | IntArray, target: FloatArray | IntArray) -> None:
    """Copy values: numba takes a second to compile the assignment of a slice."""
    for i in range(source.shape[0]):
        target[i] = source[i]


@kernel
def factorise(matrix: FloatArray, factor: FloatArray) -> bool:
    """Lower Cholesky factor with inverted diagonal; False where it does not exist."""
    n = matrix.shape[0]
    for j in range(n):
        for i in range(j, n):
            total = matrix[i, j]
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            if i > j:
                factor[i, j] = total * factor[j, j]
            elif total > 1e-12 * matrix[j, j] and matrix[j, j] > 0.0:
                factor[j, j] = 1.0 / math.sqrt(total)
            else:
                return False
    return True


@kernel
def solve(factor: FloatArray, vector: FloatArray) -> None:
    """Solve in place with the factor of `factorise`."""
    n = vector.shape[0]
    for i in range(n):
        total = vector[i]
        for k in range(i):
            total -= factor[i, k] * vector[k]
        vector[i] = total * factor[i, i]
    for i in range(n - 1, -1, -1):
        total = vector[i]
        for k in range(i + 1, n):
            total -= factor[k, i] * vector[k]
        vector[i] = total * factor[i, i]


@kernel
def slip(contacts: Contacts, contact: int, speed: FloatArray) -> float:
    """Slip speed of a contact; slip acceleration where `speed` is an acceleration."""
    one = float(speed[contacts.first[contact]])
    if contacts.second[contact] < 0:
        return one
    return one + float(contacts.direction[contact] * speed[contacts.second[contact]])


@kernel
def push(contacts: Contacts, contact: int, amount: float, load: FloatArray) -> None:
    """Add a torque along a contact to the joint torques."""
    load[contacts.first[contact]] += amount
    if contacts.second[contact] >= 0:
        load[contacts.second[contact]] += contacts.direction[contact] * amount


@kernel
def _hold(plant: Plant, mode: IntArray, work: Workspace, ddq: FloatArray) -> None:
    """Accelerations and holding torques with the stuck contacts as constraints.

    `ddq` comes in as the acceleration without the holding torques.
    """
    count = 0
    for c in range(mode.shape[0]):
        work.holding[c] = 0.0
        if mode[c] != 0 or plant.level[c] <= 0.0:
            continue
        row = work.response[count]
        for i in range(ddq.shape[0]):
            row[i] = 0.0
        push(plant.contacts, c, 1.0, row)
        solve(work.factor, row)
        for k in range(count):
            entry = slip(plant.contacts, work.independent[k], row)
            for j in range(k):
                entry -= work.schur[count, j] * work.schur[k, j]
            work.schur[count, k] = entry / work.schur[k, k]
        whole = pivot = slip(plant.contacts, c, row)
        for j in range(count):
            pivot -= work.schur[count, j] ** 2
        if pivot <= DEPENDENT * whole:
            continue
        work.schur[count, count] = math.sqrt(pivot)
        work.independent[count] = c
        count += 1
    for k in range(count):
        total = slip(plant.contacts, work.independent[k], ddq)
        for j in range(k):
            total -= work.schur[k, j] * work.holding[work.independent[j]]
        work.holding[work.independent[k]] = total / work.schur[k, k]
    for k in range(count - 1, -1, -1):
        total = work.holding[work.independent[k]]
        for j in range(k + 1, count):
            total -= work.schur[j, k] * work.holding[work.independent[j]]
        work.holding[work.independent[k]] = total / work.schur[k, k]
    for k in range(count):
        for i in range(ddq.shape[0]):
            ddq[i] -= work.response[k, i] * work.holding[work.independent[k]]
    for c in range(ddq.shape[0]):
        if mode[c] == 0 and plant.level[c] > 0.0:
            ddq[c] = 0.0
    _share(plant, mode, work.holding)


@kernel
def _share(plant: Plant, mode: IntArray, holding: FloatArray) -> None:
    """Let a coupling carry part of the holding torque where both of its joints are stuck too.

    The three holding torques are then not determined by the motion; the coupling takes the least
    that keeps the joints within their levels.
    """
    level = plant.level
    for c in range(plant.offset.shape[0], mode.shape[0]):
        a, b, sign = plant.contacts.first[c], plant.contacts.second[c], plant.contacts.direction[c]
        if level[c] <= 0.0 or mode[c] != 0 or level[a] <= 0.0 or level[b] <= 0.0:
            continue
        if mode[a] != 0 or mode[b] != 0:
            continue
        low = max(holding[a] - level[a], sign * holding[b] - level[b])
        high = min(holding[a] + level[a], sign * holding[b] + level[b])
        share = 0.5 * (low + high) if low > high else min(max(0.0, low), high)
        share = min(max(share, -level[c]), level[c])
        holding[c] = share
        holding[a] -= share
        holding[b] -= sign * share


@kernel
def accelerate(
    plant: Plant, resting: BoolArray, mode: IntArray, work: Workspace, ddq: FloatArray
) -> None:
    """Accelerations with dry friction; decides which resting contacts stay stuck.

    `work.load` holds the torques without dry friction. A resting contact is stuck while its
    holding torque is within its level, else it breaks away along the excess: a convex problem
    with one solution, found by changing one contact at a time (the worst, later the first).
    """
    contacts = mode.shape[0]
    for c in range(contacts):
        if resting[c]:
            mode[c] = 0
    for attempt in range(20 + 10 * contacts):
        stuck = False
        copy(work.load, ddq)
        for c in range(contacts):
            if plant.level[c] > 0.0 and mode[c] != 0:
                push(plant.contacts, c, -mode[c] * plant.level[c], ddq)
            stuck = stuck or (plant.level[c] > 0.0 and mode[c] == 0)
        solve(work.factor, ddq)
        if stuck:
            _hold(plant, mode, work, ddq)
        worst, change, excess = -1, 0, 0.0
        for c in range(contacts):
            if not resting[c]:
                continue
            if mode[c] == 0:
                over = abs(work.holding[c]) / plant.level[c] - 1.0
                candidate = 1 if work.holding[c] > 0.0 else -1
            else:
                back = -mode[c] * slip(plant.contacts, c, ddq)
                over, candidate = (0.0, 0) if back <= 0.0 else (1e-6, 0)
            if over > max(excess, 1e-12):
                worst, change, excess = c, candidate, over
                if attempt >= 20:
                    break
        if worst < 0:
            return
        mode[worst] = change
