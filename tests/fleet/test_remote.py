"""Bags in object storage: a real S3 server on this machine, and what is fetched of it."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from idim_iv_ros.configuration import load_configuration
from idim_iv_ros.fleet.commands import identify_task
from idim_iv_ros.fleet.robots import Robot, content_of
from idim_iv_ros.fleet.source import FetchedFile, find_bags, open_bag
from idim_iv_ros.identification.prepare import configured_request
from idim_iv_ros.recording.bags.folder import Bag
from idim_iv_ros.recording.read import read_bag
from tests.fleet.conftest import CONFIG, BagFolder

TOPICS = {"/joint_states", "/joint_reference"}


def with_camera(bag: Path, out: Path, *, every: int) -> None:
    """Copy a bag and put an image of a megabyte between its messages, `every` so many."""
    image = np.random.default_rng(1).bytes(1_000_000)
    with bag.open("rb") as source, out.open("wb") as target:
        reader = make_reader(source)
        writer = Writer(target, chunk_size=200_000, compression=CompressionType.NONE)
        writer.start("ros2", "")
        channels: dict[str, int] = {}
        for count, (schema, channel, message) in enumerate(reader.iter_messages()):
            assert schema is not None
            if channel.topic not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(channel.topic, "cdr", number)
            if count == 0:
                number = writer.register_schema("sensor_msgs/msg/Image", "ros2msg", b"")
                channels["/camera"] = writer.register_channel("/camera", "cdr", number)
            writer.add_message(
                channels[channel.topic], message.log_time, message.data, message.publish_time
            )
            if count % every == every - 1:
                # Twice: the second lies in a chunk of its own.
                for _ in range(2):
                    writer.add_message(
                        channels["/camera"], message.log_time, image, message.log_time
                    )
        writer.finish()


def bytes_of_chunks(path: Path, topics: set[str]) -> int:
    """Bytes of the chunks that hold a message of these topics, by the MCAP library's own index."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    wanted = {number for number, channel in summary.channels.items() if channel.topic in topics}
    return sum(
        chunk.chunk_length + chunk.message_index_length
        for chunk in summary.chunk_indexes
        if wanted & set(chunk.message_index_offsets)
    )


@pytest.fixture(scope="module")
def bucket() -> Iterator[str]:
    """URL of an empty bucket of a server on the loopback."""
    import boto3
    from moto.server import ThreadedMotoServer

    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    settings = {
        "AWS_ENDPOINT_URL": f"http://{host}:{port}",
        "AWS_ACCESS_KEY_ID": "testing",
        "AWS_SECRET_ACCESS_KEY": "testing",
        "AWS_DEFAULT_REGION": "us-east-1",
        "NO_PROXY": "127.0.0.1",
        "no_proxy": "127.0.0.1",
    }
    with pytest.MonkeyPatch.context() as patch:
        for name, value in settings.items():
            patch.setenv(name, value)
        boto3.client("s3").create_bucket(Bucket="fleet")
        yield "s3://fleet"
    server.stop()


def put(bucket: str, name: str, content: bytes) -> str:
    import boto3

    boto3.client("s3").put_object(Bucket=bucket.removeprefix("s3://"), Key=name, Body=content)
    return f"{bucket}/{name}"


def test_only_the_chunks_of_the_topics_are_fetched(bucket, folder, tmp_path) -> None:
    local = tmp_path / "run.mcap"
    with_camera(folder.bags[0], local, every=250)
    uri = put(bucket, "arm-1/run.mcap", local.read_bytes())
    request = configured_request(load_configuration(CONFIG))

    bag = open_bag(uri)
    far, near = read_bag(bag, request), read_bag(Bag(local), request)

    (source,) = bag.sources.values()
    assert isinstance(source, FetchedFile)
    needed = bytes_of_chunks(local, TOPICS)
    assert needed < local.stat().st_size / 1.5  # else everything would have to be fetched
    assert source.fetched <= 1.3 * needed
    assert np.array_equal(far.position.values, near.position.values)
    assert np.array_equal(far.effort.values, near.effort.values)
    assert far.notes == near.notes == ()


def test_a_torn_bag_is_read_as_far_as_it_goes(bucket: str, folder: BagFolder) -> None:
    whole = folder.bags[0].read_bytes()
    uri = put(bucket, "torn/run.mcap", whole[: len(whole) // 2])
    request = configured_request(load_configuration(CONFIG))
    recording = read_bag(open_bag(uri), request)
    assert 2.0 < recording.duration < 6.0
    assert any("ends in the middle" in note.sentence for note in recording.notes)


def test_a_bag_in_a_bucket_has_the_result_of_the_same_bag_on_disk(bucket, folder) -> None:
    robot = Robot.of(load_configuration(CONFIG))
    uri = put(bucket, "same/arm-1/run-1.mcap", folder.bags[0].read_bytes())
    far = identify_task(uri, "", "", robot)
    near = identify_task(str(folder.bags[0]), "", "", robot)
    assert near.status == "ok"
    assert far.values == near.values
    assert np.array_equal(far.r_factor, near.r_factor)


def test_a_bucket_is_searched_and_its_checksums_tell_contents_apart(bucket, folder) -> None:
    for name, bag in (("a", 0), ("b", 1), ("c", 0)):
        put(bucket, f"search/arm-1/{name}.mcap", folder.bags[bag].read_bytes())
    entries = find_bags(f"{bucket}/search")
    assert [(e.uri, e.robot) for e in entries] == [
        (f"{bucket}/search/arm-1/{name}.mcap", "arm-1") for name in "abc"
    ]
    first, second, same = (content_of(entry.uri) for entry in entries)
    assert first != second
    assert first == same
