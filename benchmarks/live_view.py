"""The live prediction: processor time, agreement with the offline filters, warnings.

python -m benchmarks.live_view > benchmarks/results/live_view.md
"""

import tempfile
import time
from pathlib import Path

import numpy as np

from idim_iv_ros import identify_recordings, load_configuration
from idim_iv_ros.configuration import Configuration
from idim_iv_ros.excitation.excite import random_motion
from idim_iv_ros.identification.prepare import prepare, read_configured
from idim_iv_ros.model import build_inverse_model, read_urdf_file
from idim_iv_ros.prediction.identified_model import IdentifiedModel, identified_model, joint_levels
from idim_iv_ros.prediction.live import JointSamples, LivePrediction
from idim_iv_ros.recording.recording import Recording
from idim_iv_ros.simulators.recording import simulate
from idim_iv_ros.types import FloatArray

ROOT = Path(__file__).resolve().parents[1]
RATE, PERIOD = 1000.0, 50  # Hz, samples between two predictions
MOTIONS = 4
CHANGES = {
    "the same robot": {},
    "first moment MX2 10 % larger": {"MX2": 1.1},
    "first moment MX2 3 % larger": {"MX2": 1.03},
    "viscous friction 20 % smaller": {"Fv1": 0.8, "Fv2": 0.8},
    "Coulomb friction 20 % larger": {"Fc1": 1.2, "Fc2": 1.2},
}


def recorded(configuration: Configuration, folder: Path, seed: int, duration: float) -> Recording:
    """One motion of the simulated robot."""
    bag = folder / f"{seed}.mcap"
    motion = random_motion(configuration, duration=duration, rate=RATE, seed=seed)
    simulate(configuration, bag, motion, seeds=(seed,))
    (path,) = folder.glob(f"{seed}*.mcap")
    (recording,) = read_configured([path], configuration)
    path.unlink()
    return recording


def identified(configuration: Configuration, folder: Path, recording: Recording) -> IdentifiedModel:
    """Its result, read back."""
    path = folder / "result.json"
    identify_recordings(recording, configuration).write(path)
    source = configuration.robot.description
    assert source is not None
    model = build_inverse_model(configuration, read_urdf_file(source), str(source))
    return identified_model(path, configuration, model, str(source))


def played(
    model: IdentifiedModel, recording: Recording
) -> tuple[LivePrediction, list[tuple[int, FloatArray]], list[tuple[float, bool]]]:
    """Predict twenty times a second; predictions by sample, and whether any joint warns."""
    live, predictions, warnings = LivePrediction(model), [], []
    for first in range(0, recording.samples, PERIOD):
        part = slice(first, min(first + PERIOD, recording.samples))
        stamps = 10**15 + np.arange(part.start, part.stop) * 1_000_000
        now = int(stamps[-1])
        live.add(
            JointSamples(stamps, recording.position.values[part]),
            JointSamples(stamps, recording.effort.values[part]),
            now,
        )
        newest = live.newest(now)
        if not newest.reason:
            predictions.append(((newest.stamp - 10**15) // 1_000_000, newest.predicted))
        if first % 1000 == 0 and live.window is not None:
            levels = joint_levels(model, live.rows, live.window.rate, 1.0)
            warnings.append((first / RATE, any(level.beyond for level in levels)))
    return live, predictions, warnings


def speed_and_agreement(folder: Path) -> None:
    """Seven joints at 1 kHz: processor time, and rows beside those of the offline filters."""
    configuration = load_configuration(ROOT / "config" / "arm7.yaml")
    recording = recorded(configuration, folder, 1, 20.0)
    model = identified(configuration, folder, recording)
    played(model, recording)
    begin = time.process_time()
    live, _, _ = played(model, recording)
    share = (time.process_time() - begin) / recording.duration
    (motion,) = prepare([recording], configuration).motions
    states = motion.derivatives(-motion.span.start, recording.samples - motion.span.start)
    residual = motion.signals.torque - model.model.matrix(*states) @ model.values
    whole = type(motion.decimation)(motion.decimation.factor, len(residual), motion.decimation.edge)
    rows = live.rows
    error = np.where(rows.counts, rows.residual - whole.at(residual, rows.places), 0.0)
    rms = np.sqrt((error**2).sum(axis=0) / rows.counts.sum(axis=0)) / model.noise_floor
    print("| seven joints, 1 kHz, 20 predictions a second | |\n|---|---|")
    print(f"| processor time of the prediction, share of one core | {100 * share:.1f} % |")
    print(f"| filters wait for | {live.window.lag:.3f} s |")
    print(
        "| rows live less rows offline, RMS over the noise floor, best to worst joint | "
        f"{rms.min():.3f} to {rms.max():.3f} |"
    )


def warnings(folder: Path) -> None:
    """An arm of two joints that changes after its identification."""
    configuration = load_configuration(ROOT / "config" / "arm2.yaml")
    model = identified(configuration, folder, recorded(configuration, folder, 1, 20.0))
    print(f"\n| arm of two joints, {MOTIONS} other motions of 30 s | seconds that warn | first |")
    print("|---|---|---|")
    for name, factors in CHANGES.items():
        parameters = dict(configuration.simulated_robot.parameters)
        parameters.update({key: parameters[key] * factor for key, factor in factors.items()})
        changed = configuration.changed("simulated_robot", parameters=parameters)
        runs = [
            played(model, recorded(changed, folder, seed, 30.0))[2]
            for seed in range(11, 11 + MOTIONS)
        ]
        warned = sum(warns for run in runs for _, warns in run)
        total = sum(map(len, runs))
        first = [next((at for at, warns in run if warns), None) for run in runs]
        times = ", ".join("never" if at is None else f"{at:.0f} s" for at in first)
        print(f"| {name} | {warned} of {total} | {times} |", flush=True)


def main() -> None:
    """Print the page."""
    print(
        "# Live prediction\n\n`python -m benchmarks.live_view`, two cores of a Xeon, 2026-11-25.\n"
    )
    with tempfile.TemporaryDirectory() as name:
        speed_and_agreement(Path(name))
        warnings(Path(name))


if __name__ == "__main__":
    main()
