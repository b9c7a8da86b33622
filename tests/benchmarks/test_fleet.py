"""The simulated fleet: its bags can be read, its damaged ones cannot, and its truth is written."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.fleet.arms import TYPE, payload
from benchmarks.fleet.make import make
from idim_iv_ros import load_configuration
from idim_iv_ros.errors import DataError
from idim_iv_ros.model import build_inverse_model
from idim_iv_ros.recording import read_recordings


def test_a_small_fleet_has_bags_a_manifest_and_the_truth(tmp_path: Path) -> None:
    make(tmp_path, robots=2, bags=2, seconds=3.0)
    truth = json.loads((tmp_path / "truth.json").read_text(encoding="utf-8"))
    with (tmp_path / "manifest.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 4 and len({row["time"] for row in rows}) == 4
    assert len(truth["corrupt"]) == 1
    joints = load_configuration(tmp_path / "arm2.yaml").robot.joints
    for row in rows:
        if row["uri"] in truth["corrupt"]:
            with pytest.raises(DataError):
                read_recordings([tmp_path / row["uri"]], joints=joints)
        else:
            (recording,) = read_recordings([tmp_path / row["uri"]], joints=joints)
            assert recording.duration == pytest.approx(3.0, abs=0.01)


def test_a_payload_changes_the_base_parameters_as_a_body_on_the_last_link_does() -> None:
    configuration = load_configuration(Path(__file__).parents[2] / "config" / "arm2.yaml")
    urdf = configuration.robot.urdf
    assert urdf is not None
    model = build_inverse_model(configuration, urdf.read_text(encoding="utf-8"), urdf.name)
    layout = model.regressor.layout
    x, z, mass = 0.34, 0.03, 0.5
    body = dict.fromkeys((parameter.name for parameter in layout.parameters), 0.0)
    body.update(M2=mass, MX2=mass * x, MZ2=mass * z, XX2=mass * z**2, ZZ2=mass * x**2)
    body.update(YY2=mass * (x**2 + z**2), XZ2=-mass * x * z)
    vector = np.array([body[parameter.name] for parameter in layout.parameters])
    expected = dict(zip(model.base.names, model.base.from_standard(vector), strict=True))
    for name in TYPE:
        assert payload(mass, x, z).get(name, 0.0) == pytest.approx(expected[name], abs=1e-12)
