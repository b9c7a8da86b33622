"""The STS3215 of the data set: its masses are known, its torque is not recorded."""

import numpy as np

from benchmarks.servos import sts3215
from idim_iv_ros.servo.fit import fit_factor
from idim_iv_ros.servo.robot_fit import fit_joint
from tests.real.conftest import DATA


def test_masses_of_runs_that_were_not_used():
    runs = {
        name: run
        for name, run in sts3215(DATA / "feetech_sts3215").items()
        if name.startswith("sin_sin") and "_kp12_" in name
    }
    answer = fit_joint([run for name, run in runs.items() if "0.535" in name])
    factors = np.array(
        [fit_factor(run, answer, "load")[0] for n, run in runs.items() if "0.969" in n]
    )
    assert len(factors) == 4
    np.testing.assert_allclose(factors, 1.0, atol=0.05)
