"""Where bags of a fleet are found: in folders, manifests and buckets."""

from collections.abc import Iterator
from pathlib import Path

import boto3
import numpy as np
import pyarrow
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from moto.server import ThreadedMotoServer
from pyarrow import csv, parquet

from idim_iv_ros.configuration import load_configuration
from idim_iv_ros.errors import UsageError
from idim_iv_ros.fleet.commands import identify_task
from idim_iv_ros.fleet.source import (
    BagEntry,
    FetchedFile,
    Robot,
    content_of,
    find_bags,
    open_bag,
    robots_of,
)
from idim_iv_ros.identification.prepare import configured_request
from idim_iv_ros.recording.bags.folder import Bag
from idim_iv_ros.recording.read import read_bag
from tests.fleet.conftest import CONFIG, BagFolder


def touched(folder: Path, *names: str) -> None:
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"")


@pytest.mark.parametrize(
    ("files", "expected"),
    [
        (
            ["ur5/r17/a.mcap", "ur5/r18/b.db3", "ur5/r18/notes.txt", "ur5/.c.mcap"],
            [("ur5", "r17", "a.mcap"), ("ur5", "r18", "b.db3")],
        ),
        (["b.mcap", "a.mcap"], [("", "fleet", "a.mcap"), ("", "fleet", "b.mcap")]),
        (["r1/day/metadata.yaml", "r1/day/0.mcap", "r1/day/1.mcap"], [("", "r1", "day")]),
    ],
)
def test_folders_name_type_and_robot(tmp_path, files, expected) -> None:
    touched(tmp_path / "fleet", *files)
    entries = find_bags(str(tmp_path / "fleet"))
    assert [(e.type, e.robot, Path(e.uri).name) for e in entries] == expected


def test_a_manifest_names_robots_and_times(tmp_path: Path) -> None:
    manifest = tmp_path / "m.csv"
    manifest.write_text(
        "uri,robot,type,time,site\n"
        "a.mcap,r1,ur5,2026-03-01T13:00:00+01:00,Ulm\n"
        "s3://bucket/b.mcap,r2,,2026-03-02 08:30:00,\n",
        encoding="utf-8",
    )
    assert find_bags(str(manifest)) == (
        BagEntry(str(tmp_path / "a.mcap"), "r1", "ur5", "2026-03-01T12:00:00Z"),
        BagEntry("s3://bucket/b.mcap", "r2", "", "2026-03-02T08:30:00Z"),
    )


def test_a_manifest_in_parquet_says_the_same(tmp_path: Path) -> None:
    text = "uri,robot,time,line\nb.mcap,r2,2026-03-02T08:30:00Z,7\n"
    (tmp_path / "m.csv").write_text(text, encoding="utf-8")
    table = csv.read_csv(tmp_path / "m.csv")
    assert pyarrow.types.is_timestamp(table.schema.field("time").type)
    parquet.write_table(table, tmp_path / "m.parquet")
    assert find_bags(str(tmp_path / "m.parquet")) == find_bags(str(tmp_path / "m.csv"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "names no bag"),
        ("file,robot\na.mcap,r1\n", "no column uri; it has file, robot"),
        ("uri,robot\na.mcap,\n", "row 2: robot is empty"),
        ("uri,robot\na.mcap,r1\na.mcap,r1\n", "row 3: a.mcap is listed twice"),
        ("uri,robot,time\na.mcap,r1,yesterday\n", "row 2: time yesterday is not in ISO 8601"),
        ("uri,robot\na.mcap,r1,more\n", "row 2: its columns are not those of the first line"),
    ],
)
def test_a_wrong_manifest_ends_in_one_line(tmp_path: Path, text: str, words: str) -> None:
    manifest = tmp_path / "m.csv"
    manifest.write_text(text, encoding="utf-8")
    with pytest.raises(UsageError, match=words):
        find_bags(str(manifest))


def test_the_configuration_of_a_robot_goes_before_that_of_its_type(tmp_path: Path) -> None:
    text = CONFIG.read_text(encoding="utf-8").replace("arm2.urdf", str(CONFIG.parent / "arm2.urdf"))
    for name in ("ur5", "r2"):
        (tmp_path / f"{name}.yaml").write_text(text, encoding="utf-8")
    entries = [BagEntry("a.mcap", "r1", "ur5"), BagEntry("b.mcap", "r2", "ur5")]
    _, robots = robots_of(entries, tmp_path)
    sources = [robots[robot].configuration.source for robot in ("r1", "r2")]
    assert sources == [tmp_path / "ur5.yaml", tmp_path / "r2.yaml"]
    with pytest.raises(UsageError, match=r"neither r3\.yaml nor kuka\.yaml is there"):
        robots_of([BagEntry("c.mcap", "r3", "kuka")], tmp_path)


def test_a_robot_of_two_types_is_refused() -> None:
    entries = [BagEntry("a.mcap", "r1", "ur5"), BagEntry("b.mcap", "r1", "ur10")]
    with pytest.raises(UsageError, match="r1 is of type ur10 here and of type ur5 elsewhere"):
        robots_of(entries, CONFIG)


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
                    time = message.log_time
                    writer.add_message(channels["/camera"], time, image, time)
        writer.finish()


def bytes_of_chunks(path: Path, topics: set[str]) -> int:
    """Bytes of the chunks that hold a message of these topics, by the MCAP library's own index."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    wanted = {number for number, channel in summary.channels.items() if channel.topic in topics}
    return sum(
        chunk.chunk_length + chunk.message_index_length
        for chunk in summary.chunk_indexes
        if wanted & set(chunk.message_index_offsets)
    )


@pytest.fixture(scope="module")
def bucket() -> Iterator[str]:
    """URL of an empty bucket of a server on the loopback."""
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
    recording = read_bag(open_bag(uri), configured_request(load_configuration(CONFIG)))
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
