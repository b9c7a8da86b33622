"""Results of robots whose parameters are known, as files that can be exported."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from idim_iv_ros import export
from idim_iv_ros.configuration import Configuration, load_configuration
from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.errors import UsageError
from idim_iv_ros.model import InverseModel, build_inverse_model, kinematics_digest, read_urdf_file
from idim_iv_ros.physical import nearest_physical
from idim_iv_ros.simulator_files.export import Exported
from tests.inputs import gap_content

CONFIG = Path(__file__).resolve().parents[2] / "config"
# Attributes of an MJCF that an export changes.
CHANGING = {
    "inertial": ("mass", "pos", "fullinertia", "diaginertia", "quat"),
    "joint": ("armature", "damping", "frictionloss", "solreffriction", "solimpfriction"),
}


@dataclass(frozen=True)
class Case:
    """A robot's configuration, and the gap.json of a diagnosis of it."""

    configuration: Configuration
    model: InverseModel
    gap: GapResult
    path: Path

    def export(self, out: Path, *, refit: bool = True, **options: Any) -> Exported:
        return export(self.path, self.configuration, out, refit=refit, **options)

    def with_gap(self, **changes: Any) -> "Case":
        case = replace(self, gap=replace(self.gap, **changes))
        case.path.write_text(case.gap.to_json(), encoding="utf-8")
        return case

    def vector(self, *without: str) -> np.ndarray:
        """Standard parameters of the result, zero for those whose names begin so."""
        names = self.model.regressor.layout.names
        return np.array(
            [0.0 if name.startswith(without) else self.standard[name] for name in names]
        )

    @property
    def standard(self) -> dict[str, float]:
        return self.gap.physical.values


def refused(arm: Case, out: Path, match: str) -> None:
    """Refused in one line, and nothing is written."""
    with pytest.raises(UsageError, match=match):
        arm.export(out)
    assert not out.exists()


def bare(text: str, changing: Mapping[str, Sequence[str]]) -> str:
    """Canonical XML with its comments, without attributes (by path of the element) that change.

    An element whose list is empty is left out as a whole.
    """
    builder = ElementTree.TreeBuilder(insert_comments=True)
    root = ElementTree.fromstring(text, ElementTree.XMLParser(target=builder))
    for tag, attributes in changing.items():
        for parent in list(root.iter()):
            for element in parent.findall(tag):
                for name in attributes:
                    element.attrib.pop(name, None)
                if not attributes:
                    parent.remove(element)
    whole = ElementTree.tostring(root, encoding="unicode")
    return ElementTree.canonicalize(whole, with_comments=True, strip_text=True)


def case(
    folder: Path,
    configuration: Configuration | str,
    causes: Sequence[Mapping[str, Any]] = (),
    *,
    change: float = 0.1,
) -> Case:
    """A robot that differs from its nominal model, with some causes.

    `change`: of the links, as a share of the nominal parameters.
    """
    if isinstance(configuration, str):
        configuration = load_configuration(CONFIG / f"{configuration}.yaml")
    file = configuration.robot.description
    model = build_inverse_model(configuration, read_urdf_file(file), file.name)
    random = np.random.default_rng(3)
    values = model.given * (1.0 + change * random.uniform(-1.0, 1.0, len(model.given)))
    values += np.array([0.1 if name.startswith("off") else 0.0 for name in model.base.names])
    std = 0.02 * np.abs(values) + 1e-4
    physical = nearest_physical(model.robot, model.base, values, np.diag(std**2))
    joints = model.robot.joints
    content = json.dumps(gap_content(*causes))
    gap = replace(
        GapResult.from_json(content, "sample"),
        joints=joints,
        joint_types=model.robot.joint_types,
        robot=model.robot.name,
        physical=physical,
        kinematics=kinematics_digest(model.robot),
    )
    path = folder / "gap.json"
    path.write_text(gap.to_json(), encoding="utf-8")
    return Case(configuration, model, gap, path)


def cause(effect: str, joint: str | None, **parameters: float) -> dict[str, Any]:
    """One structural cause."""
    return {
        "effect": effect,
        "joint": joint,
        "other_joint": None,
        "indistinguishable_from": [],
        "parameters": parameters,
    }
