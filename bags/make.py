"""Make the recording of the demo: a simulated six-joint arm that is not what its file says."""

import json
from pathlib import Path

import numpy as np

from bags import simulated_arms
from idim_iv_ros.model import build_inverse_model
from idim_iv_ros.recording.writing.write import write_bag

FOLDER = Path(__file__).parent
SECONDS, RATE, SEED = 20.0, 1000.0, 20170401


def main() -> None:
    """Write arm6.mcap and arm6.truth.json."""
    arm = simulated_arms.arm6(seconds=SECONDS, rate=RATE)
    record = simulated_arms.record(arm, SEED, encoder_resolution=2.0 * np.pi / 2**19)
    urdf = arm.configuration.robot.urdf
    assert urdf is not None
    text = urdf.read_text(encoding="utf-8")
    topics = simulated_arms.joint_topics(arm, record)
    write_bag(FOLDER / "arm6.mcap", topics, robot_description=text)
    model = build_inverse_model(arm.configuration, text, urdf.name)
    values = model.base.from_standard(model.regressor.layout.vector(arm.truth))
    truth = {name: float(value) for name, value in zip(model.base.names, values, strict=True)}
    (FOLDER / "arm6.truth.json").write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
