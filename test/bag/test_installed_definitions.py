"""A bag without definitions, such as a .db3 of Humble, is read by those of the installed packages."""

import os
import sqlite3
from pathlib import Path

import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from worlds.bags.user_bag_factory import SECOND, Seen, UserBag
from worlds.bags.user_bag_factory import VISION_4 as DEFINITIONS

from semantic_slam.bag.reader import BagReader
from semantic_slam.errors import InputError

BOXES = "vision_msgs/msg/Detection2DArray"


def write_as_humble(path: Path) -> Path:
    """A sqlite3 bag of one message of boxes as Humble records it: its schema 3 has no table of definitions."""
    with UserBag(path.with_name("mcap")) as known:
        message = known.vision_4(SECOND, [Seen("cup", 30.0)])
        cdr = known.store.serialize_cdr(message, BOXES)
        with Writer(path, version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
            writer.write(writer.add_connection("/boxes", BOXES, typestore=known.store), SECOND, cdr)
    (storage,) = path.glob("*.db3")
    with sqlite3.connect(storage) as database:
        database.execute("DROP TABLE message_definitions")
        database.execute("UPDATE schema SET schema_version = 3, ros_distro = 'humble'")
    return path


def install(prefix: Path, *, without: str = "") -> None:
    """The .msg files of vision_msgs below a prefix, as packages install them: nested types without the package."""
    folder = prefix / "share" / "vision_msgs" / "msg"
    folder.mkdir(parents=True)
    for name, text in DEFINITIONS.items():
        if name != without:
            (folder / f"{name}.msg").write_text(f"# A comment.\n{text.replace('vision_msgs/', '')}\n")


def labels_of(path: Path) -> list[str]:
    with BagReader(path) as reader:
        (message,) = reader.messages()
        decoded = reader.decode(message.cdr, message.type_name)
    return [row.results[1].hypothesis.class_id for row in decoded.detections]


def test_a_bag_of_humble_is_read_where_the_package_is_installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = write_as_humble(tmp_path / "bag")
    with BagReader(bag) as reader:
        assert reader.definitions == {}
    install(tmp_path / "workspace")
    monkeypatch.setenv("AMENT_PREFIX_PATH", os.pathsep.join([str(tmp_path / "empty"), str(tmp_path / "workspace")]))
    assert labels_of(bag) == ["cup"]


@pytest.mark.parametrize("without", [None, "ObjectHypothesis"])
def test_without_the_package_the_remedy_is_one_that_can_be_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, without: str | None
) -> None:
    if without is not None:
        install(tmp_path / "workspace", without=without)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "workspace"))
    with pytest.raises(InputError, match=r"source a workspace that has vision_msgs, or convert .* ros2 bag convert"):
        labels_of(write_as_humble(tmp_path / "bag"))


def test_a_type_name_that_leads_elsewhere_is_not_looked_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "share").mkdir()
    (tmp_path / "msg").mkdir()
    (tmp_path / "msg" / "Passwords.msg").write_text("string text\n")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    with BagReader(write_as_humble(tmp_path / "bag")) as reader, pytest.raises(InputError, match="neither embedded"):
        reader.decode(b"\x00\x01\x00\x00", "../msg/Passwords")
