"""What a careful engineer does without a catalogue: least squares, and one ripple.

New base parameters by least squares; a given number that is farther off than five of its deviations
and takes more than a percent of the torque is named, the largest first. What is left of a joint is
correlated with waves of its position: the strongest is a ripple where it takes more than a percent.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from idim_iv_ros.compilation import one_thread
from idim_iv_ros.configuration import load_configuration
from idim_iv_ros.errors import IdimError
from idim_iv_ros.estimation.least_squares import solve_least_squares
from idim_iv_ros.estimation.observation import observation_rows
from idim_iv_ros.identification.prepare import prepare, read_configured

_DEVIATIONS = 5.0
_SHARE = 0.01  # of the torque (rms)
_WAVES = np.arange(1.0, 60.0, 0.5)  # per rad
_KINDS = {"Ia": "drive_inertia", "Fv": "friction_level", "Fc": "friction_level",
          "off": "torque_offset"}  # fmt: skip


def baseline_rows(folder: Path) -> Iterator[dict[str, Any]]:
    """Causes of one recording by least squares; none where it cannot be fitted."""
    configuration = load_configuration(folder / "robot.yaml")
    joints = configuration.robot.joints
    with one_thread():
        try:
            bags = [str(path) for path in sorted(folder.glob("*.mcap"))]
            prepared = prepare(read_configured(bags, configuration), configuration)
            rows = observation_rows(prepared.model, prepared.motions)
            fit = solve_least_squares(rows, len(prepared.model.base.columns))
        except IdimError:
            return
    given = prepared.given
    shares: dict[tuple[str, str], float] = {}
    names = prepared.model.base.names
    normal = np.zeros((len(names), len(names)))
    for part, sigma in zip(rows, fit.sigma, strict=True):
        normal[np.ix_(part.columns, part.columns)] += part.matrix.T @ part.matrix / sigma**2
    deviations = np.sqrt(np.diag(np.linalg.pinv(normal)))
    for joint, part in enumerate(rows):
        size = float(np.sqrt(np.mean(part.torque**2)))
        for place, column in enumerate(part.columns if given is not None else ()):
            assert given is not None
            change = fit.values[column] - given[column]
            share = float(np.sqrt(np.mean((part.matrix[:, place] * change) ** 2))) / size
            if share < _SHARE or abs(change) < _DEVIATIONS * deviations[column]:
                continue
            kind = names[column].rstrip("0123456789")
            at = int(names[column][len(kind) :]) - 1
            effect = _KINDS.get(kind, "payload" if at == len(joints) - 1 else "link_inertia")
            key = effect, joints[at]
            shares[key] = max(shares.get(key, 0.0), share)
        rest = part.torque - part.matrix @ fit.values[part.columns]
        position = np.concatenate(
            [
                m.position[m.span][m.decimation.kept][m.kept[:, joint], joint]
                for m in prepared.motions
            ]
        )
        waves = np.exp(1j * _WAVES[:, None] * position) @ rest / len(rest)
        share = float(np.sqrt(2.0) * np.abs(waves).max()) / size
        if share > _SHARE:
            shares["position_ripple", joints[joint]] = share
    for (effect, joint_name), _ in sorted(shares.items(), key=lambda item: -item[1]):
        yield {"recording": folder.name, "effect": effect, "joint": joint_name}
