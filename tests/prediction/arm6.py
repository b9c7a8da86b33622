"""The recording of the demo: 20 s of six joints at 1 kHz, and what its nodes would receive."""

from functools import cache
from pathlib import Path

import numpy as np

from idim_iv_ros.configuration import Configuration, load_configuration
from idim_iv_ros.identification.identify import identify_recordings
from idim_iv_ros.identification.prepare import read_configured
from idim_iv_ros.model import read_urdf_file
from idim_iv_ros.prediction.live import JointSamples, LivePrediction, Prediction
from idim_iv_ros.recording.recording import Recording

ROOT = Path(__file__).resolve().parents[2]
YAML = ROOT / "config" / "arm6.yaml"
START = 1_700_000_000_000_000_000
PERIOD = 50_000_000  # ns between two predictions


def configured() -> Configuration:
    return load_configuration(YAML)


@cache
def recorded() -> Recording:
    (recording,) = read_configured([ROOT / "bags" / "arm6.mcap"], configured())
    return recording


def write_result(path: Path) -> Path:
    identify_recordings(recorded(), configured(), estimator="idim-ls").write(path)
    return path


def urdf_of(configuration: Configuration) -> tuple[str, str]:
    path = configuration.robot.description
    assert path is not None
    return read_urdf_file(path), str(path)


def samples(
    recording: Recording, seconds: slice = slice(None), every: int = 1
) -> tuple[JointSamples, JointSamples]:
    """Positions and efforts as published; one in `every` messages."""
    time = START + np.round(np.arange(recording.samples) * 1e9 / recording.rate).astype(np.int64)
    first, last = (
        None if end is None else round(end * recording.rate)
        for end in (seconds.start, seconds.stop)
    )
    kept = slice(first, last, every)
    return (
        JointSamples(time[kept], recording.position.values[kept]),
        JointSamples(time[kept], recording.effort.values[kept]),
    )


def play(live: LivePrediction, positions: JointSamples, efforts: JointSamples) -> list[Prediction]:
    """Hand over what arrives in each twentieth of a second, and predict."""
    predictions = []
    begin, end = int(positions.time[0]), int(positions.time[-1])
    for now in range(begin + PERIOD, end + PERIOD, PERIOD):
        # By the time of arrival: what is stamped before belongs to it, in the order that it has.
        first, last = np.searchsorted(np.maximum.accumulate(positions.time), [now - PERIOD, now])
        inside = slice(int(first), int(last))
        live.add(positions.part(inside), efforts.part(inside), now)
        predictions.append(live.newest(now))
    return predictions
