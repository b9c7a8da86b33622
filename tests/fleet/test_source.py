"""Which bags a fleet has: manifests, folders, object storage."""

from pathlib import Path

import pytest

from idim_iv_ros.errors import UsageError
from idim_iv_ros.fleet.robots import robots_of
from idim_iv_ros.fleet.source import BagEntry, find_bags
from tests.fleet.conftest import CONFIG


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
    import pyarrow
    from pyarrow import csv, parquet

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
    with pytest.raises(UsageError, match=words) as error:
        find_bags(str(manifest))
    assert "\n" not in str(error.value)


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
