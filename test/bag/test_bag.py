"""Bags are read back as written, by us and by others' readers, and up to the damage when they are damaged."""

import hashlib
import shutil
from itertools import islice

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from semantic_slam.bag.definitions import register
from semantic_slam.bag.reader import BagReader, TruncatedBagError
from semantic_slam.bag.storage import storage_files
from semantic_slam.bag.writer import BagWriter
from semantic_slam.errors import InputError
from semantic_slam.messages.codec import from_message, to_message
from semantic_slam.messages.ground_truth import GroundTruthObjects
from semantic_slam.messages.standard import OdometryEstimate
from semantic_slam.messages.typestore import serialize, typestore

OBJECTS = GroundTruthObjects(5, ("1",), ("cup",), np.arange(7.0)[None])
YOLO = "yolo_msgs/msg/DetectionArray"
YOLO_TEXT = "\n".join(
    [
        "std_msgs/Header header",
        "yolo_msgs/Detection[] detections",
        "=" * 80,
        "MSG: yolo_msgs/Detection",
        "float64 score",
    ]
)
YOLO_BYTES = bytes.fromhex("00010000 07000000 08000000 02000000 6100 0000 01000000 00000000 000000000000f03f")


def odometry(stamp):
    return OdometryEstimate(stamp, "odom", "base_link", np.array([stamp, 0, 0, 0, 0, 0, 1.0]), np.eye(6))


def write_bag(path, n=50, padding=0):
    """One latched message, then n odometry messages, each followed by ``padding`` random bytes."""
    noise = np.random.default_rng(0)
    with BagWriter(path) as writer:
        writer.write("/ground_truth/objects", OBJECTS, 0)
        for stamp in range(1, n + 1):
            writer.write("odom", odometry(stamp), stamp)
            if padding:
                body = noise.bytes(padding)
                cdr = b"\x00\x01\x00\x00" + len(body).to_bytes(4, "little") + body
                writer.write_raw("/noise", "noise_msgs/msg/Noise", cdr, stamp, "uint8[] data")
    return path


def decoded_by_mcap_ros2(path):
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [message for _, _, _, message in reader.iter_decoded_messages()]


def read_all(reader, topics=None):
    return list(reader.messages(topics))


@pytest.mark.parametrize("form", ["folder", "file"])
def test_round_trip(tmp_path, form):
    bag = write_bag(tmp_path / "bag")
    path = bag if form == "folder" else bag / "bag.mcap"
    with BagReader(path) as reader:
        assert reader.topics == {
            "/ground_truth/objects": "semantic_slam_msgs/msg/GroundTruthObjects",
            "/odom": "nav_msgs/msg/Odometry",
        }
        assert reader.num_messages == 51
        assert reader.sha256() == hashlib.sha256((bag / "bag.mcap").read_bytes()).hexdigest()
        found = read_all(reader, ["odom"])
        assert [message.stamp_ns for message in found] == list(range(1, 51))
        value = from_message(reader.decode(found[6].cdr, found[6].type_name))
        np.testing.assert_array_equal(value.pose, odometry(7).pose)
        assert read_all(reader, ["/nothing"]) == []


def test_other_readers_read_it(tmp_path):
    bag = write_bag(tmp_path / "bag")
    messages = decoded_by_mcap_ros2(bag / "bag.mcap")
    assert len(messages) == 51
    assert list(messages[0].object_ids) == ["1"]
    assert messages[9].pose.pose.position.x == 9.0
    with AnyReader([bag]) as reader:
        connection, _, raw = next(iter(reader.messages()))
        assert reader.deserialize(raw, connection.msgtype).class_names == ["cup"]
        assert connection.digest == typestore().hash_rihs01(connection.msgtype)


def test_latched_topics_offer_transient_local(tmp_path):
    text = (write_bag(tmp_path / "bag") / "metadata.yaml").read_text()
    assert text.count("durability: transient_local") == 1
    assert "version: 9" in text


def test_a_foreign_type_travels_with_its_definition(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        writer.write_raw("/yolo/detections", YOLO, YOLO_BYTES, 5, YOLO_TEXT)
    with BagReader(tmp_path / "bag") as reader:
        (message,) = read_all(reader)
        decoded = reader.decode(message.cdr, message.type_name)
    assert decoded.header.stamp.sec == 7
    assert [item.score for item in decoded.detections] == [1.0]
    (other,) = decoded_by_mcap_ros2(tmp_path / "bag" / "bag.mcap")
    assert other.detections[0].score == 1.0


def test_a_foreign_type_without_definition_is_refused(tmp_path):
    with BagWriter(tmp_path / "bag") as writer, pytest.raises(InputError, match=YOLO):
        writer.write_raw("/yolo/detections", YOLO, YOLO_BYTES, 5)


def test_another_definition_of_our_type_is_named(tmp_path):
    name = "semantic_slam_msgs/msg/GroundTruthObjects"
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/ground_truth/objects", name, msgdef="string[] ids\n", rihs01="RIHS01_0")
        writer.write(connection, 1, b"\x00\x01\x00\x00\x00\x00\x00\x00")
    with (
        BagReader(tmp_path / "bag") as reader,
        pytest.raises(InputError, match=r"GroundTruthObjects.*another definition"),
    ):
        reader.decode(read_all(reader)[0].cdr, name)


STORAGES = [(plugin, mode) for plugin in StoragePlugin for mode in CompressionMode]
STORAGES.remove((StoragePlugin.SQLITE3, CompressionMode.STORAGE))  # sqlite3 has no compression of its own


@pytest.mark.parametrize(("plugin", "mode"), STORAGES)
def test_every_storage_and_compression(tmp_path, plugin, mode):
    writer = Writer(tmp_path / "bag", version=9, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/odom", "nav_msgs/msg/Odometry", typestore=typestore())
        for stamp_ns in (3, 3 + 7_200 * 10**9):
            writer.write(connection, stamp_ns, serialize(to_message(odometry(3))))
    with BagReader(tmp_path / "bag") as reader:
        message, _ = read_all(reader, ["odom"])
        assert reader.duration_s == pytest.approx(7200.0)
        assert from_message(reader.decode(message.cdr, message.type_name)).stamp_ns == 3


def test_a_fault_keeps_what_was_written_before(tmp_path):
    with pytest.raises(RuntimeError), BagWriter(tmp_path / "bag") as writer:
        writer.write("odom", odometry(1), 1)
        raise RuntimeError
    with BagReader(tmp_path / "bag") as reader:
        assert len(read_all(reader)) == 1


def cut(path, share):
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])


@pytest.mark.parametrize("suffix", [".mcap", ".mcap.zstd"])
def test_the_parts_of_a_split_recording_are_in_the_order_of_their_numbers(tmp_path, suffix):
    """Parts 0 to 10 without a metadata.yaml, which would tell their order; as text, 10 comes before 2."""
    for number in (10, 2, 0, 9, 1):
        (tmp_path / f"rosbag2_2024_01_02_{number}{suffix}").touch()
    found = [item.name.removesuffix(suffix) for item in storage_files(tmp_path)]
    assert found == [f"rosbag2_2024_01_02_{number}" for number in (0, 1, 2, 9, 10)]


def write_parts(folder, names):
    """A folder without metadata.yaml of a storage file for each name, with one message."""
    folder.mkdir()
    for stamp, name in enumerate(names, start=1):
        with BagWriter(folder / "part") as writer:
            writer.write("odom", odometry(stamp), stamp)
        (part,) = (folder / "part").glob("*.mcap")
        part.rename(folder / name)
        shutil.rmtree(folder / "part")
    return folder


def test_a_killed_recorders_parts_are_read_in_the_order_of_time_which_is_said(tmp_path, capsys):
    with BagReader(write_parts(tmp_path / "split", [f"split_{number}.mcap" for number in range(11)])) as reader:
        assert [message.stamp_ns for message in reader.messages()] == list(range(1, 12))
    told = capsys.readouterr().err
    assert "split_0.mcap, split_1.mcap" in told and "and 3 others are read as the parts of one recording" in told


@pytest.mark.parametrize(
    "names",
    [
        ("drive_0.mcap", "room_0.mcap"),
        ("drive_1.mcap", "drive_2.mcap"),
        ("run0.mcap", "run1.mcap"),
        ("drive.mcap", "drive_0.mcap"),
    ],
)
def test_several_recordings_in_a_folder_without_metadata_are_not_merged(tmp_path, names):
    folder = write_parts(tmp_path / "bags", names)
    with pytest.raises(InputError, match=rf"{names[0]}, {names[1]} are no parts of one .*; give one of them") as told:
        BagReader(folder).__enter__()
    assert str(folder / names[0]) in str(told.value)
    with BagReader(folder / names[1]) as reader:
        assert reader.num_messages == 1


def test_parts_that_are_missing_are_told_and_a_part_that_is_there_twice_is_refused(tmp_path, capsys):
    folder = write_parts(tmp_path / "split", ["split_0.mcap", "split_2.mcap"])
    (folder / "._split_0.mcap").write_bytes(b"left by another system's copy")
    with BagReader(folder) as reader:
        assert reader.num_messages == 2
    assert "one recording, of which others are missing" in capsys.readouterr().err
    (folder / "split_0.mcap.zstd").touch()  # by a recorder that was stopped while it compressed
    with pytest.raises(InputError, match=r"split_0 is there twice .*; remove one of the two"):
        BagReader(folder).__enter__()


@pytest.mark.parametrize("form", ["folder", "file", "folder without metadata"])
@pytest.mark.parametrize("share", [0.3, 0.7, 0.95])
def test_a_truncated_mcap_gives_everything_before_the_damage(tmp_path, form, share):
    bag = write_bag(tmp_path / "bag", n=200, padding=20_000)  # 4 MB of noise: several chunks, the cut lies inside one
    cut(bag / "bag.mcap", share)
    if form == "folder without metadata":
        (bag / "metadata.yaml").unlink()
    found = []
    with BagReader(bag / "bag.mcap" if form == "file" else bag) as reader:
        with pytest.raises(TruncatedBagError, match=r"bag is damaged .*messages before the damage"):
            found.extend(reader.messages(["/odom"]))
        assert reader.topics["/odom"] == "nav_msgs/msg/Odometry"
        assert reader.num_messages == pytest.approx(2 * len(found) + 1, abs=1)
        assert reader.duration_s == pytest.approx(len(found) * 1e-9, abs=1.5e-9)
        assert reader.decode(found[-1].cdr, found[-1].type_name).pose.pose.position.x == len(found)
    assert [message.stamp_ns for message in found] == list(range(1, len(found) + 1))
    assert (
        share * 200 - 10 <= len(found) < 200
    )  # zstd gives blocks of 128 kB: at most 7 messages are lost in the cut chunk


def test_a_mcap_that_lacks_only_its_end_gives_all_messages(tmp_path):
    bag = write_bag(tmp_path / "bag")
    data = (bag / "bag.mcap").read_bytes()
    (bag / "bag.mcap").write_bytes(data[:-30])
    found = []
    with BagReader(bag) as reader, pytest.raises(TruncatedBagError):
        found.extend(reader.messages())
    assert len(found) == 51


def test_damage_inside_a_chunk_is_named_after_the_messages_before_it(tmp_path):
    bag = write_bag(tmp_path / "bag", n=200, padding=20_000)
    data = bytearray((bag / "bag.mcap").read_bytes())
    data[len(data) // 2 : len(data) // 2 + 300_000] = bytes(300_000)
    (bag / "bag.mcap").write_bytes(data)
    found = []
    with BagReader(bag) as reader, pytest.raises(TruncatedBagError):
        found.extend(reader.messages(["odom"]))
    assert 0 < len(found) < 200


@pytest.mark.parametrize(
    ("name", "content", "text"),
    [
        ("no.mcap", None, "no such bag"),
        ("a.mcap", b"not an mcap", "no mcap file"),
        ("a.txt", b"x", "not a readable bag"),
        ("a.bag", b"#ROSBAG V2.0\n", r"a bag of ROS 1; convert it with rosbags-convert --src \S+a.bag --dst \S+a, and"),
    ],
)
def test_what_is_no_bag_is_named(tmp_path, name, content, text):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=text) as caught, BagReader(path):
        pass
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_empty_folder_is_no_bag(tmp_path):
    with pytest.raises(InputError, match="not a readable bag"), BagReader(tmp_path):
        pass


def test_a_writer_never_replaces_an_old_bag_and_takes_an_empty_folder(tmp_path):
    (tmp_path / "bag").mkdir()
    write_bag(tmp_path / "bag", n=3)
    with pytest.raises(InputError, match="exists already; name another output"):
        write_bag(tmp_path / "bag", n=2)
    with BagReader(tmp_path / "bag") as reader:
        assert reader.num_messages == 4


def test_anything_else_is_never_overwritten(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(InputError, match=r"thesis\.tex"):
        BagWriter(tmp_path)
    with pytest.raises(InputError, match="no bag folder"):
        BagWriter(tmp_path / "thesis.tex")
    assert (tmp_path / "thesis.tex").read_text() == "years of work"


def test_reading_starts_before_the_whole_bag_is_read(tmp_path):
    bag = write_bag(tmp_path / "bag")
    with BagReader(bag) as reader:
        assert [message.stamp_ns for message in islice(reader.messages(), 2)] == [0, 1]


@pytest.mark.parametrize("seed", range(12))
def test_random_damage_is_told_and_changes_nothing_before_it(tmp_path, seed):
    """Ten flipped bits, or a beginning that is missing."""
    chance = np.random.default_rng(seed)
    bag = write_bag(tmp_path / "bag", n=60, padding=20_000)
    with BagReader(bag) as reader:
        whole = read_all(reader)
    data = bytearray((bag / "bag.mcap").read_bytes())
    for _ in range(10):
        data[chance.choice([chance.integers(len(data)), -1 - chance.integers(2000)])] ^= 1 << chance.integers(8)
    (bag / "bag.mcap").write_bytes(data[chance.integers(2) * chance.integers(len(data)) :])
    found = []
    with pytest.raises(InputError) as told, BagReader(bag) as reader:
        found.extend(reader.messages())
    assert str(bag) in str(told.value) and "\n" not in str(told.value)
    assert found == whole[: len(found)] and len(found) < len(whole)


def test_a_type_of_several_lines_is_refused_in_one() -> None:
    with pytest.raises(InputError, match="embedded definition is not readable") as refused:
        register(typestore(), "foreign_msgs/msg/Two\nLines", "MSG:\nno definition")
    assert "\n" not in str(refused.value)
