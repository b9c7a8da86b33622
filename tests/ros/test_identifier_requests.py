"""What the identifier refuses, and what it does with what others announce."""

import os
from pathlib import Path
from types import SimpleNamespace

import pytest

from idim_iv_interfaces.msg import BagClosed
from idim_iv_ros.errors import UsageError
from idim_iv_ros.nodes.identifier.job import confined, confined_bag
from idim_iv_ros.nodes.identifier.node import ACTIVE, Identifier
from idim_iv_ros.nodes.settings import IdentifierSettings


@pytest.fixture
def outside(tmp_path: Path) -> Path:
    """A bag that lies beside the folder of the bags."""
    path = tmp_path / "outside.mcap"
    path.write_bytes(bytes(100))
    return path


@pytest.fixture
def inside(tmp_path: Path) -> Path:
    folder = tmp_path / "bags"
    folder.mkdir()
    return folder


def test_names_inside_are_found(inside: Path) -> None:
    bag = inside / "day" / "bag"
    bag.mkdir(parents=True)
    (bag / "one.mcap").write_bytes(bytes(100))
    (bag / "metadata.yaml").write_bytes(bytes(10))
    (inside / "latest").symlink_to("day/bag")
    for name in ("day/bag", str(bag), "latest"):
        assert confined_bag(inside, name) == (bag.resolve(), 110)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("", "names no file"),
        ("bag\0", "names no file"),
        ("../outside.mcap", "'..' is not allowed"),
        ("day/../../outside.mcap", "'..' is not allowed"),
        ("/etc/passwd", "leads out of"),
        ("link.mcap", "leads out of"),
        ("folder", "its file one.mcap leads out of"),
        ("pipes", "is no regular file"),
        ("loop", "no such"),
        ("missing.mcap", "no such bag"),
        ("x" * 5000, "5000 characters is too long"),
    ],
)
def test_names_that_lead_out_are_refused(
    inside: Path, outside: Path, name: str, words: str
) -> None:
    (inside / "day").mkdir()
    (inside / "link.mcap").symlink_to(outside)
    (inside / "folder").mkdir()
    (inside / "folder" / "one.mcap").symlink_to(outside)
    (inside / "pipes").mkdir()
    os.mkfifo(inside / "pipes" / "one.mcap")
    (inside / "loop").symlink_to("loop")
    with pytest.raises(UsageError, match=words) as refused:
        confined_bag(inside, name)
    assert "\n" not in str(refused.value)


def test_folder_beside_with_the_same_beginning_is_outside(inside: Path) -> None:
    sibling = inside.with_name("bags2")
    sibling.mkdir()
    with pytest.raises(UsageError, match="leads out of"):
        confined(inside, str(sibling), "bag_directory")


def test_announced_bag_is_left_alone_without_auto_and_if_it_is_not_whole() -> None:
    node, asked = SimpleNamespace(_managed=SimpleNamespace(state=ACTIVE)), []
    node._submit = lambda _, request, listener: asked.extend(request.bags)
    node.node = SimpleNamespace(get_logger=lambda: SimpleNamespace(warning=print))
    for auto, complete in ((False, True), (True, False), (True, True)):
        node._settings = IdentifierSettings(auto=auto)
        Identifier._bag_closed(node, BagClosed(bag=f"{auto} {complete}", complete=complete))
    assert asked == ["True True"]
