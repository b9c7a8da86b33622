"""Worlds with known truth for the Monte Carlo tests: autocorrelated regressions and a pendulum."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.signal import butter, cheby1, lfilter, sosfiltfilt

from idim_iv_ros.estimation.rows import JointRows


def joint_rows(name, x, z, torque, columns, segments) -> JointRows:
    """Rows of one joint with instruments."""
    return JointRows(x, torque, columns, tuple(segments), name, instrument_matrix=z)


def runs_of(positions):
    """Slices of the rows whose positions follow one another."""
    cuts = np.flatnonzero(np.diff(positions) != 1) + 1
    edges = [0, *cuts.tolist(), len(positions)]
    return tuple(slice(a, b) for a, b in pairwise(edges))


def autoregressive(rng, coefficients: Sequence[float], shape):
    """Series of unit variance with C(z⁻¹) = 1 + c₁ z⁻¹ + …."""
    start = 500
    noise = rng.standard_normal((shape[0] + start, *shape[1:]))
    series = lfilter([1.0], [1.0, *coefficients], noise, axis=0)[start:]
    impulse = lfilter([1.0], [1.0, *coefficients], np.eye(1, start)[0])
    return series / np.linalg.norm(impulse)


def autocorrelated_world(
    rng,
    residual_noise_model,
    error_model,
    *,
    n_rows=500,
    n_columns=10,
    band=(0.002, 0.1),
    error=0.05,
    deviation=0.0,
    endogeneity=0.0,
):
    """One joint with X = Z Π + V and y = X β + ε; returns its rows and the IV estimate.

    `band` holds the frequencies of Z in cycles per row; V has rms `error` against about 1.7
    of Z; `deviation` is the entry of Π − I that one column gets; `endogeneity` puts that share
    of V β into ε. One row in four hundred is lost.
    """
    time = np.arange(n_rows)[:, None]
    instruments = np.zeros((n_rows, n_columns))
    for _ in range(6):
        frequency = rng.uniform(*band, n_columns)
        phase = rng.uniform(0.0, 2.0 * np.pi, n_columns)
        instruments += rng.standard_normal(n_columns) * np.sin(2 * np.pi * frequency * time + phase)
    v = error * autoregressive(rng, error_model, (n_rows, n_columns))
    regressor = instruments + v
    regressor[:, 0] += deviation * instruments[:, 1]
    truth = rng.uniform(0.5, 2.0, n_columns) * rng.choice([-1.0, 1.0], n_columns)
    clean = regressor @ truth
    residual = 0.1 * clean.std() * autoregressive(rng, residual_noise_model, (n_rows,))
    torque = clean + residual + endogeneity * (v @ truth)
    kept = np.sort(rng.permutation(n_rows)[: n_rows - n_rows // 400])
    instruments, regressor, torque = instruments[kept], regressor[kept], torque[kept]
    estimate = np.linalg.solve(instruments.T @ regressor, instruments.T @ torque)
    columns = np.arange(n_columns)
    return joint_rows("joint", regressor, instruments, torque, columns, runs_of(kept)), estimate


_DT = 0.001
_TIME = np.arange(0.0, 8.0, _DT)
_TRUTH = np.array([2.0, 8.0, 5.0, 20.0])  # Ia kg m², Fv N m s/rad, Fc N m, MX g N m


def _reference():
    parts = [(0.5, 0.25, 0.0), (0.3, 0.6, 1.0), (0.2, 1.1, 2.0)]
    return sum(a * np.sin(2 * np.pi * f * _TIME + phase) for a, f, phase in parts)


def _closed_loop(parameters, disturbance=None):
    """PD-controlled pendulums, one per row of `parameters` (m, 4); q and torque (n, m)."""
    inertia, viscous, coulomb, gravity = parameters.T
    reference = _reference()
    speed_reference = np.gradient(reference, _DT)
    q = np.full(len(parameters), reference[0])
    dq = np.full(len(parameters), speed_reference[0])
    positions = np.empty((len(_TIME), len(parameters)))
    torques = np.empty_like(positions)
    for k in range(len(_TIME)):
        positions[k] = q
        torques[k] = 4000.0 * (reference[k] - q) + 150.0 * (speed_reference[k] - dq)
        push = torques[k] if disturbance is None else torques[k] + disturbance[k]
        ddq = push - viscous * dq - coulomb * np.tanh(dq / 0.005) - gravity * np.cos(q)
        dq = dq + _DT * ddq / inertia
        q = q + _DT * dq
    return positions, torques


def _low_pass(values, factor):
    sos = cheby1(8, 0.05, 0.8 / factor, output="sos")
    return sosfiltfilt(sos, values, axis=0)[:: int(factor)]


def _columns(positions, factor):
    q = sosfiltfilt(butter(4, 50.0, fs=1.0 / _DT, output="sos"), positions, axis=0)
    dq = np.gradient(q, _DT, axis=0)
    full = np.stack([np.gradient(dq, _DT, axis=0), dq, np.sign(dq), np.cos(q)], axis=-1)
    return _low_pass(full, factor), dq[:: int(factor)]


def pendulums(rng, count, *, with_gravity, factor=25, noise=1e-4):
    """IDIM-IV on `count` simulated pendulums; yields (rows, estimate) for each.

    Position noise in rad; the torque disturbance is low-passed at 10 Hz, 2 N m rms. Without
    gravity its column is left out of the model that is identified and simulated.
    """
    shape = (len(_TIME), count)
    push = sosfiltfilt(
        butter(2, 10.0, fs=1.0 / _DT, output="sos"), rng.standard_normal(shape), axis=0
    )
    q, torque = _closed_loop(np.tile(_TRUTH, (count, 1)), 2.0 * push / push.std())
    regressor, dq = _columns(q + noise * rng.standard_normal(shape), factor)
    measured = _low_pass(torque, factor)
    used = [0, 1, 2, 3] if with_gravity else [0, 1, 2]
    inner = np.zeros(len(dq), dtype=bool)
    inner[5:-5] = True
    kept = [np.flatnonzero((np.abs(dq[:, i]) > 0.05) & inner) for i in range(count)]
    parameters = np.zeros((count, 4))
    parameters[:, 0] = 1.0
    for _ in range(6):
        instruments, _ = _columns(_closed_loop(parameters)[0], factor)
        for i in range(count):
            z, x = instruments[kept[i], i][:, used], regressor[kept[i], i][:, used]
            parameters[i, used] = np.linalg.solve(z.T @ x, z.T @ measured[kept[i], i])
    for i in range(count):
        at = kept[i]
        rows = joint_rows(
            "pendulum",
            regressor[at, i][:, used],
            instruments[at, i][:, used],
            measured[at, i],
            np.arange(len(used)),
            runs_of(at),
        )
        yield rows, parameters[i, used]
