"""What is predicted live is what the identification would say of the same samples."""

import json
from dataclasses import replace

import numpy as np
import pytest

from idim_iv_ros.errors import UsageError
from idim_iv_ros.identification.prepare import prepare
from idim_iv_ros.model import build_inverse_model
from idim_iv_ros.prediction.identified_model import IdentifiedModel, identified_model, joint_levels
from idim_iv_ros.prediction.live import (
    CURVE_TOLERANCE,
    ROW_TOLERANCE,
    JointSamples,
    LivePrediction,
    Prediction,
)
from idim_iv_ros.signals.decimation import ParallelDecimation
from idim_iv_ros.signals.filters import central_differences, zero_phase_butterworth
from idim_iv_ros.signals.motion import difference_order
from idim_iv_ros.types import FloatArray
from tests.inputs import changed
from tests.prediction.arm6 import PERIOD, START, play, samples, urdf_of

FIVE = slice(0, 5)  # s: enough for everything but the statistics
RATE = 1000.0


@pytest.fixture(scope="module")
def played(identified, recording) -> tuple[LivePrediction, list[Prediction]]:
    live = LivePrediction(identified)
    return live, play(live, *samples(recording))


@pytest.fixture(scope="module")
def offline(identified, recording, configuration):
    """Motion of the whole recording as `identify` filters it, and the predicted effort."""
    (motion,) = prepare([recording], configuration).motions
    q, dq, ddq = motion.derivatives(-motion.span.start, recording.samples - motion.span.start)
    return motion, ddq, identified.model.matrix(q, dq, ddq) @ identified.values


def places(predictions: list[Prediction]) -> np.ndarray:
    stamps = np.array([prediction.stamp for prediction in predictions])
    return np.round((stamps - START) * 1e-9 * RATE).astype(int)


def test_curves_are_those_of_the_offline_filters_on_what_had_arrived(identified, played, offline):
    """The whole past of the recording, filtered at once, as far as it had come by then."""
    live, predictions = played
    motion, acceleration, _ = offline
    window, order = live.window, identified.result.processing.position_order
    # The window keeps all but the share ROW_TOLERANCE of what is behind it; see below.
    tolerance = 2.0 * ROW_TOLERANCE * _largest_effort(identified, motion, acceleration)
    for prediction in [prediction for prediction in predictions if not prediction.reason][50::250]:
        (place,) = places([prediction])
        smoothed = place + window._smooth_wait + 1
        filtered = zero_phase_butterworth(
            motion.signals.position[: smoothed + window._wait],
            rate=RATE,
            cutoff=window._cutoff,
            order=order,
        )
        derivatives = central_differences(
            filtered, rate=RATE, start=0, order=difference_order(window._cutoff, RATE)
        )
        predicted = identified.model.matrix(filtered, *derivatives) @ identified.values
        both = np.hstack([motion.signals.torque[:smoothed], predicted[:smoothed]])
        both = zero_phase_butterworth(both, rate=RATE, cutoff=window._smoothing, order=order)
        measured, predicted = np.split(both[place], 2)
        assert prediction.measured == pytest.approx(measured, abs=1e-6)
        there = np.isfinite(prediction.predicted)
        assert there.any()
        assert np.all(np.abs(prediction.predicted - predicted)[there] < tolerance[there])


def test_curves_lose_no_more_than_the_share_that_they_do_not_wait_for(identified, played, offline):
    live, predictions = played
    motion, acceleration, predicted = offline
    valid = [prediction for prediction in predictions if not prediction.reason]
    assert len(valid) > 0.95 * len(predictions)
    both = zero_phase_butterworth(
        np.hstack([motion.signals.torque, predicted]),
        rate=RATE,
        cutoff=live.window._smoothing,
        order=identified.result.processing.position_order,
    )
    measured, predicted = np.split(both[places(valid)], 2, axis=1)
    # Both filters leave out the share CURVE_TOLERANCE of their impulse response. The reflection
    # that continues an effort errs by four times its size at most; that of a position has the
    # opposite acceleration, and errs by twice that of the motion.
    smoothed = np.array([prediction.measured for prediction in valid])
    peaks = np.abs(motion.signals.torque).max(axis=0)
    assert np.all(np.abs(smoothed - measured) < 4.0 * CURVE_TOLERANCE * peaks)
    error = np.array([prediction.predicted for prediction in valid]) - predicted
    assert np.isfinite(error).mean() > 0.5
    largest = _largest_effort(identified, motion, acceleration)
    assert np.all(np.nanmax(np.abs(error), axis=0) < 2.0 * CURVE_TOLERANCE * largest)
    usual = _largest_effort(identified, motion, acceleration, root_mean_square)
    assert np.all(root_mean_square(error) < 2.0 * CURVE_TOLERANCE * usual)


def root_mean_square(values: FloatArray) -> FloatArray:
    return np.sqrt(np.nanmean(values**2, axis=0))


def largest_size(values: FloatArray) -> FloatArray:
    return np.abs(values).max(axis=0)


def _largest_effort(
    identified: IdentifiedModel, motion, acceleration: FloatArray, size=largest_size
) -> FloatArray:
    """Effort (n_joints,) of accelerations of this size, by the largest mass matrix of the motion.

    The filters have not settled in the first and last fifth of a second: nothing moves like that.
    """
    joints = acceleration.shape[1]
    q = motion.position[:: len(acceleration) // 20]
    still = np.zeros_like(q)
    rest = identified.model.matrix(q, still, still) @ identified.values
    largest = np.zeros((joints, joints))
    for joint in range(joints):
        unit = still.copy()
        unit[:, joint] = 1.0
        effort = identified.model.matrix(q, still, unit) @ identified.values - rest
        largest[:, joint] = np.abs(effort).max(axis=0)
    return largest @ size(acceleration[200:-200])


def test_rows_equal_the_parallel_decimation_of_the_identification(identified, played, offline):
    live, _ = played
    motion, _, predicted = offline
    factor = motion.decimation.factor
    assert live.rows.rate == pytest.approx(identified.result.processing.row_rate)
    whole = ParallelDecimation(factor, len(predicted), motion.decimation.edge)
    residual = whole.at(motion.signals.torque - predicted, live.rows.places)
    counts = live.rows.counts
    error = np.where(counts, live.rows.residual - residual, 0.0)
    rms = np.sqrt((error**2).sum(axis=0) / counts.sum(axis=0))
    # A hundredth of the impulse response is left out, of a residual that is larger before it is
    # decimated and where a joint turns back.
    assert np.all(rms < 0.05 * identified.noise_floor)


def test_on_its_own_recording_the_residual_is_as_large_as_the_identification_left_it(
    identified, played
) -> None:
    live, predictions = played
    # The live rows are others of the same residual, and lack those of the first second.
    assert live.rows.share(1e9, 100) == pytest.approx(identified.noise_floor, rel=0.1)
    shares = np.array([prediction.noise_share for prediction in predictions])
    assert np.nanmedian(shares, axis=0) == pytest.approx(1.0, abs=0.2)
    for level in joint_levels(identified, live.rows, RATE, false_warnings=1.0):
        assert not level.beyond, level.sentence
        assert level.limit > 1.0
        assert level.seconds > 8.0


def test_a_sample_is_predicted_within_a_fifth_of_a_second(played) -> None:
    live, predictions = played
    delays = [
        START + PERIOD * (number + 1) - prediction.stamp
        for number, prediction in enumerate(predictions)
        if not prediction.reason
    ]
    assert max(delays) * 1e-9 <= live.window.lag + 2.0 / RATE
    assert live.window.lag < 0.16


def test_a_payload_is_beyond_the_limit(identified, recording) -> None:
    """Half a kilogram more at the last link, by the columns of its mass and first moment."""
    positions, efforts = samples(recording, slice(0, 8))
    base = identified.model.base
    heavier = identified.values.copy()
    heavier[base.names.index("MX3")] += 0.5
    changed = replace(identified, values=heavier)
    live = LivePrediction(changed)
    play(live, positions, efforts)
    levels = joint_levels(changed, live.rows, RATE, false_warnings=1.0)
    assert any(level.beyond for level in levels)
    assert "identify anew" in next(level.sentence for level in levels if level.beyond)


def in_two_messages(stream: JointSamples, *, apart: int, reverse: bool = False) -> JointSamples:
    """Each sample as two: three joints, and the other three from `apart` samples later."""
    count = len(stream) - apart
    named = np.zeros((2, count, stream.values.shape[1]), dtype=bool)
    named[0, :, :3] = named[1, :, 3:] = True
    values = np.stack([stream.values[:count], stream.values[apart:]])
    time = np.stack([stream.time[:count], stream.time[apart:]])
    order = slice(None, None, -1 if reverse else 1)
    whole = slice(None, None, 1 + apart)

    def arriving(array: np.ndarray) -> np.ndarray:
        paired = np.stack(list(array[order]), axis=1)[whole]
        return paired.reshape(-1, *paired.shape[2:])

    about = arriving(named)
    return JointSamples(arriving(time), np.where(about, arriving(values), np.nan), about)


@pytest.mark.parametrize("reverse", [False, True])
def test_joints_in_messages_of_one_stamp_are_predicted_as_in_one_message(
    identified, recording, reverse: bool
) -> None:
    pair = samples(recording, slice(0, 3))
    whole, split = LivePrediction(identified), LivePrediction(identified)
    expected = play(whole, *pair)[-1]
    last = play(split, *(in_two_messages(stream, apart=0, reverse=reverse) for stream in pair))[-1]
    assert (split.window.rate, split.late) == (RATE, 0)
    assert last.reason == "" and last.stamp == expected.stamp
    np.testing.assert_allclose(last.predicted, expected.predicted, atol=1e-6)
    np.testing.assert_allclose(last.measured, expected.measured, atol=1e-6)


def test_joints_in_messages_with_other_stamps_are_on_their_own_clocks(identified, recording):
    pair = samples(recording, FIVE)
    split = LivePrediction(identified)
    apart = [in_two_messages(stream, apart=1, reverse=True) for stream in pair]
    assert not play(split, *apart)[-1].reason
    assert (split.window.rate, split.late) == (RATE / 2.0, 0)
    shares = []
    for first in (0, 1):  # all joints at the stamps of the first three, and of the others
        whole = LivePrediction(identified)
        play(whole, *(stream.part(slice(first, None, 2)) for stream in pair))
        shares.append(whole.rows.share(1e9, 50))
    expected = np.concatenate([shares[0][:3], shares[1][3:]])
    assert split.rows.share(1e9, 50) == pytest.approx(expected, rel=0.05)


def test_an_effort_that_is_nan_silences_its_joint_alone(identified, recording) -> None:
    positions, efforts = samples(recording, slice(0, 4))
    values = efforts.values.copy()
    values[2000:, 2] = np.nan
    last = play(LivePrediction(identified), positions, JointSamples(efforts.time, values))[-1]
    assert last.reason == ""
    assert np.isnan(last.measured[2]) and np.isnan(last.predicted[2]) and np.isnan(last.residual[2])
    assert np.isfinite(np.delete(last.measured, 2)).all()


def test_a_short_gap_is_left_out_and_a_long_one_begins_anew(identified, recording) -> None:
    positions, efforts = samples(recording, slice(0, 6))

    def without(first: int, last: int) -> list[Prediction]:
        kept = np.r_[0:first, last : len(positions)]
        return play(LivePrediction(identified), positions.part(kept), efforts.part(kept))

    short = without(3000, 3100)
    assert [prediction.reason for prediction in short[20:] if prediction.reason] == []
    around = [prediction for prediction in short if abs(prediction.stamp - START - 3.05e9) < 3e7]
    assert around
    assert all(np.isnan(prediction.predicted).all() for prediction in around)
    long = without(2500, 4000)
    reasons = [prediction.reason for prediction in long if prediction.reason]
    assert any(reason.startswith("no position for") for reason in reasons)
    assert any(reason.startswith("no sample for 1.5 s:") for reason in reasons)
    assert long[-1].reason == ""
    assert np.isfinite(long[-1].predicted).any()


def test_another_rate_is_noticed_and_taken_up(identified, recording) -> None:
    fast, slow = samples(recording, slice(0, 3)), samples(recording, slice(3, 9), every=4)
    pair = [
        JointSamples(np.concatenate([a.time, b.time]), np.concatenate([a.values, b.values]))
        for a, b in zip(fast, slow, strict=True)
    ]
    live = LivePrediction(identified)
    predictions = play(live, *pair)
    reasons = {prediction.reason for prediction in predictions}
    assert any("position changed from 1000 to 250 Hz" in reason for reason in reasons)
    assert live.window.rate == 250.0
    assert predictions[-1].reason == ""
    # White noise of the efforts, one sample in four, has four times the power in the same band.
    shares = live.rows.share(1e9, 20) / identified.noise_floor
    assert np.all((shares > 1.0) & (shares < 2.4))
    for level in joint_levels(identified, live.rows, live.window.rate, false_warnings=1.0):
        assert level.limit is None
        assert "250 Hz" in level.sentence and "1000 Hz" in level.sentence


def test_a_rate_below_the_filter_is_refused_with_both_numbers(identified, recording) -> None:
    last = play(LivePrediction(identified), *samples(recording, slice(0, 3), every=40))[-1]
    cutoff = identified.result.processing.position_cutoff
    for number in (25.0, cutoff, 2 * cutoff):
        assert f"{number:g} Hz" in last.reason


def test_samples_out_of_order_are_left_out_and_a_clock_set_back_begins_anew(identified, recording):
    positions, efforts = samples(recording, slice(0, 2))
    time = positions.time.copy()
    time[1000] -= 5_000_000
    live = LivePrediction(identified)
    predictions = play(live, replace(positions, time=time), replace(efforts, time=time))
    assert live.late == 1
    assert predictions[-1].reason == ""
    live = LivePrediction(identified)
    play(live, positions, efforts)
    reasons = [prediction.reason for prediction in play(live, positions, efforts)]
    assert any("back by 2 s" in reason for reason in reasons)
    assert reasons[-1] == ""


def test_positions_that_wrap_are_unwrapped(identified, recording) -> None:
    positions, efforts = samples(recording, slice(0, 2))
    turned = positions.values + 3.0  # so that they pass π
    wrapped = np.mod(turned + np.pi, 2.0 * np.pi) - np.pi
    assert (np.abs(np.diff(wrapped, axis=0)) > np.pi).any()
    one = play(LivePrediction(identified), JointSamples(positions.time, turned), efforts)
    other = play(LivePrediction(identified), JointSamples(positions.time, wrapped), efforts)
    for a, b in zip(one, other, strict=True):
        assert a.reason == b.reason
        assert b.predicted == pytest.approx(a.predicted, abs=1e-6, nan_ok=True)


def test_a_joint_without_any_position_is_named(identified, recording) -> None:
    positions, efforts = samples(recording, slice(0, 1))
    values = positions.values.copy()
    values[:, 1] = np.nan
    last = play(LivePrediction(identified), JointSamples(positions.time, values), efforts)[-1]
    assert "position of joint_2" in last.reason


@pytest.mark.parametrize(
    ("section", "values", "words"),
    [
        ("robot", {"gravity": [0.0, 0.0, 9.81]}, "another robot.gravity"),
        ("robot", {"joints": [f"joint_{k}" for k in (2, 1, 3, 4, 5, 6)]}, "another robot"),
        ("signals", {"effort_scale": [2.0] * 6}, "another signals.effort_scale"),
        ("signals", {"effort_unit": "A"}, "another signals.effort_unit"),
        ("robot", {"motor_to_joint": np.eye(6).tolist()}, "another robot.motor_to_joint"),
        ("identification", {"friction": ["viscous"]}, "another identification.friction"),
    ],
)
def test_a_result_of_another_configuration_is_refused_in_one_line(
    result, configuration, identified, section, values, words
) -> None:
    other = changed(configuration, section, **values)
    with pytest.raises(UsageError, match=words):
        identified_model(result, other, identified.model, "arm6.urdf")


def test_a_result_of_another_urdf_is_refused(result, configuration) -> None:
    text, source = urdf_of(configuration)
    place = text.index("<origin", text.index('<joint name="joint_2"'))
    end = text.index("/>", place)
    longer = text[:place] + '<origin xyz="0.1 0.2 0.3" rpy="0 0 0"' + text[end:]
    model = build_inverse_model(configuration, longer, source)
    with pytest.raises(UsageError, match="placed or turned"):
        identified_model(result, configuration, model, source)


@pytest.mark.parametrize("processing", [{"colour": 1}, {"decimation_edge": -1.0}, 5])
def test_a_result_of_unknown_processing_is_refused(
    tmp_path, result, configuration, identified, processing
) -> None:
    document = json.loads(result.read_text())
    document["configuration"]["processing"] = processing
    path = tmp_path / "result.json"
    path.write_text(json.dumps(document))
    with pytest.raises(UsageError):
        identified_model(path, configuration, identified.model, "arm6.urdf")


def test_signals_of_motors_are_brought_to_the_joints(identified, recording) -> None:
    """Gears of a hundred and efforts in quarters: the same robot, the same predictions."""
    ratio, scale = 100.0, 0.25
    transform = replace(
        identified.transform, to_joint=np.eye(6) / ratio, to_torque=np.eye(6) * ratio * scale
    )
    motors = replace(identified, transform=transform)
    positions, efforts = samples(recording, slice(0, 2))
    expected = play(LivePrediction(identified), positions, efforts)[-1]
    prediction = play(
        LivePrediction(motors),
        replace(positions, values=positions.values * ratio),
        replace(efforts, values=efforts.values / ratio / scale),
    )[-1]
    assert prediction.measured == pytest.approx(expected.measured, abs=1e-6)
    assert prediction.predicted == pytest.approx(expected.predicted, abs=1e-6, nan_ok=True)
