"""A bit that flips in a bag of ours is found: what is read is what was written, or reading ends with one line."""

import shutil
import struct
import zlib
from itertools import islice, product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from mcap.opcode import Opcode
from mcap.records import Chunk, DataEnd, Footer
from mcap.stream_reader import StreamReader
from mcap.writer import IndexType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import StoragePlugin, Writer

from semantic_slam.bag.chunk_limits import RECORD_HEADER
from semantic_slam.bag.mcap_stream import RawMessage
from semantic_slam.bag.reader import BagReader, TruncatedBagError
from semantic_slam.bag.writer import BagWriter
from semantic_slam.errors import InputError

SHIPPED = Path(__file__).parents[2] / "bags"
TEXT = "std_msgs/msg/String"
NOT_SUMMED = "was written without checksums"


class Read(NamedTuple):
    """What reading a bag gave, and the line that ended it."""

    described: tuple[Any, ...]
    messages: list[RawMessage]
    fault: str


def text(content: str) -> bytes:
    """CDR of a string message."""
    data = content.encode() + b"\0"
    return b"\0\1\0\0" + struct.pack("<I", len(data)) + data


def fill(writer: BagWriter) -> None:
    """Thirty messages on two topics, in ten chunks."""
    for stamp in range(1, 31):
        writer.write_raw(("/one", "/other")[stamp % 2], TEXT, text(f"message {stamp} " * 20), stamp)
        if stamp % 3 == 0:
            writer.flush()


def closed(path: Path) -> Path:
    with BagWriter(path) as writer:
        fill(writer)
    return path


def bare(path: Path) -> Path:
    """The storage file of a closed bag."""
    return closed(path) / f"{path.name}.mcap"


def killed(path: Path) -> Path:
    """As its recorder leaves it when it is killed: without summary and metadata."""
    writer = BagWriter(path)
    writer.__enter__()
    fill(writer)
    return path


def begin_of_the_shipped_one(path: Path) -> Path:
    with BagReader(SHIPPED / "aliased_room") as reader, BagWriter(path) as writer:
        for count, message in enumerate(islice(reader.messages(), 60)):
            writer.write_raw(*message[:2], message.cdr, message.stamp_ns, reader.definitions[message.type_name])
            if count % 20 == 19:
                writer.flush()
    return path / f"{path.name}.mcap"


def read(bag: Path) -> Read:
    described: tuple[Any, ...] = ()
    messages: list[RawMessage] = []
    try:
        with BagReader(bag) as reader:
            described = (reader.topics, reader.definitions, reader.counts)
            messages.extend(reader.messages())
    except InputError as error:
        return Read(described, messages, str(error))
    return Read(described, messages, "")


def flips(file: Path, count: int, seed: int) -> Any:
    """Flip one bit after the other, every second one near the end, where index and footer are."""
    chance, data = np.random.default_rng(seed), file.read_bytes()
    for number in range(count):
        place = int(chance.integers(len(data) if number % 2 else min(len(data), 3000)))
        flipped = bytearray(data)
        flipped[place if number % 2 else -1 - place] ^= 1 << int(chance.integers(8))
        file.write_bytes(flipped)
        yield number
    file.write_bytes(data)


def check(found: Read, whole: Read, bag: Path) -> None:
    """What was found is all of it, or its beginning with one line that names the bag."""
    if not found.fault:
        assert found == whole
    assert found.messages == whole.messages[: len(found.messages)]
    assert "\n" not in found.fault and (not found.fault or str(bag) in found.fault)


@pytest.mark.parametrize(("make", "count"), [(closed, 60), (bare, 150), (killed, 150), (begin_of_the_shipped_one, 30)])
def test_a_flipped_bit_in_the_storage_is_found_or_changes_nothing(tmp_path: Path, make: Any, count: int) -> None:
    """Nothing depends on a chunk's times, the entries of its index, and the copy of metadata.yaml."""
    bag = make(tmp_path / "bag")
    whole = read(bag)
    assert not whole.fault and len(whole.messages) >= 30
    faults = 0
    for _ in flips(bag if bag.is_file() else bag / "bag.mcap", count, seed=7):
        found = read(bag)
        check(found, whole, bag)
        faults += bool(found.fault)
    assert faults > count / 3
    assert read(bag) == whole


def test_no_record_of_an_unfinished_bag_passes_for_one_of_another_kind_or_length(tmp_path: Path) -> None:
    """A chunk that passed for something unknown would be left out, an index that passed for a message be one more."""
    bag = killed(tmp_path / "bag")
    file, whole = bag / "bag.mcap", read(bag)
    data, places = file.read_bytes(), record_places(file)
    of_one_chunk = [place for place in places if chunk_places(file)[4] <= place < chunk_places(file)[5]]
    assert len(of_one_chunk) == 3
    for place, bit in product(of_one_chunk, range(8 * RECORD_HEADER.size)):
        flipped = bytearray(data)
        flipped[place + bit // 8] ^= 1 << bit % 8
        file.write_bytes(flipped)
        found = read(bag)
        check(found, whole, bag)
        assert found.fault or data[place] == Opcode.MESSAGE_INDEX  # which passed for an application's own record
        if found.fault and "claims more than 256 MiB" not in found.fault:
            assert len(found.messages) in (12, 15)


def test_a_flipped_bit_in_metadata_is_found_or_changes_nothing(tmp_path: Path) -> None:
    bag = closed(tmp_path / "bag")
    whole = read(bag)
    for _ in flips(bag / "metadata.yaml", 80, seed=3):
        check(read(bag), whole, bag)


def test_damage_is_named_with_file_and_place_after_what_is_before_it(tmp_path: Path) -> None:
    bag = closed(tmp_path / "bag")
    storage = bag / "bag.mcap"
    chunks = chunk_places(storage)
    data = bytearray(storage.read_bytes())
    data[(chunks[4] + chunks[5]) // 2] ^= 1
    storage.write_bytes(data)
    with BagReader(bag) as reader, pytest.raises(TruncatedBagError) as caught:
        list(reader.messages())
    assert f"bag.mcap: the chunk at byte {chunks[4]} does not fit its checksum" in str(caught.value)
    assert "the 12 messages before the damage were used; record it again" in str(caught.value)


def record_places(storage: Path) -> list[int]:
    """Where the records before the end of the data begin."""
    data, places, at = storage.read_bytes(), [], 8
    while at < len(data) and data[at] != Opcode.DATA_END:
        places.append(at)
        at += RECORD_HEADER.size + RECORD_HEADER.unpack_from(data, at)[1]
    return places


def chunk_places(storage: Path) -> list[int]:
    data = storage.read_bytes()
    return [place for place in record_places(storage) if data[place] == Opcode.CHUNK]


@pytest.mark.parametrize("make", [bare, begin_of_the_shipped_one])
def test_bags_of_ours_carry_all_checksums_of_the_format(tmp_path: Path, make: Any) -> None:
    check_checksums(make(tmp_path / "bag"))


@pytest.mark.parametrize("name", ["aliased_room/aliased_room.mcap", "standing.mcap"])
def test_the_shipped_bags_carry_checksums(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    check_checksums(SHIPPED / name)
    with BagReader(SHIPPED / name):
        assert capsys.readouterr().err == ""


def check_checksums(storage: Path) -> None:
    """Check that mcap's reader finds checksums, and that they fit."""
    with storage.open("rb") as file:
        records = list(StreamReader(file, emit_chunks=True, validate_crcs=True).records)
    with storage.open("rb") as file:
        list(StreamReader(file, validate_crcs=True).records)  # those of chunks are compared where they are unpacked
    assert all(record.uncompressed_crc for record in records if isinstance(record, Chunk))
    (end,) = (record for record in records if isinstance(record, DataEnd))
    assert end.data_section_crc
    footer = records[-1]
    assert isinstance(footer, Footer) and footer.summary_crc == zlib.crc32(
        storage.read_bytes()[footer.summary_start : -12]
    )


def test_the_same_messages_are_the_same_bytes(tmp_path: Path) -> None:
    first, second = (bare(tmp_path / folder / "bag").read_bytes() for folder in ("one", "two"))
    assert first == second


@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_a_bag_without_checksums_is_named_once(
    tmp_path: Path, plugin: StoragePlugin, capsys: pytest.CaptureFixture[str]
) -> None:
    write_as_others(tmp_path / "bag", plugin)
    for _ in range(2):
        assert len(read(tmp_path / "bag").messages) == 3
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"{tmp_path / 'bag'}: {NOT_SUMMED}")


def test_a_bag_of_ours_is_not_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    read(closed(tmp_path / "bag"))
    read(killed(tmp_path / "killed"))
    assert NOT_SUMMED not in capsys.readouterr().err


def write_as_others(path: Path, plugin: StoragePlugin) -> None:
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        connection = writer.add_connection("/one", TEXT, msgdef="string data\n", rihs01="RIHS01_0")
        for stamp in range(1, 4):
            writer.write(connection, stamp, text("text"))


@pytest.mark.parametrize("use_chunking", [True, False])
@pytest.mark.parametrize("index_types", [IndexType.ALL, IndexType.CHUNK, IndexType.NONE])
def test_what_other_recorders_leave_out_drops_no_message(
    tmp_path: Path, use_chunking: bool, index_types: IndexType, capsys: pytest.CaptureFixture[str]
) -> None:
    """With ``noMessageIndex`` every message was dropped without a word."""
    bag = tmp_path / "bag.mcap"
    with bag.open("wb") as file:
        writer = McapWriter(file, chunk_size=400, use_chunking=use_chunking, index_types=index_types)
        writer.start(profile="ros2")
        schema = writer.register_schema(TEXT, "ros2msg", b"string data")
        channels = [writer.register_channel(topic, "cdr", schema) for topic in ("/one", "/other")]
        for stamp in range(1, 31):
            writer.add_message(channels[stamp % 2], stamp, text("text"), stamp)
        writer.finish()
    with BagReader(bag) as reader:
        assert [message.stamp_ns for message in reader.messages()] == list(range(1, 31))
        assert [message.stamp_ns for message in reader.messages(["/one"])] == list(range(2, 31, 2))
    assert (NOT_SUMMED in capsys.readouterr().err) == (not use_chunking)


def changed(bag: Path, old: str, new: str) -> Path:
    """The bag with another metadata.yaml."""
    file = bag / "metadata.yaml"
    before = file.read_text()
    assert old in before
    file.write_text(before.replace(old, new))
    return bag


def test_metadata_that_name_a_file_twice_are_refused(tmp_path: Path) -> None:
    bag = changed(closed(tmp_path / "bag"), "paths:\n  - bag.mcap", "paths:\n  - bag.mcap\n  - bag.mcap")
    with pytest.raises(InputError, match=r"metadata.yaml names bag.mcap 2 times; .* reindex"), BagReader(bag):
        pass


def test_metadata_that_leave_a_file_out_are_refused(tmp_path: Path) -> None:
    bag = closed(tmp_path / "bag")
    shutil.copy(bag / "bag.mcap", bag / "other.mcap")
    with pytest.raises(InputError, match=r"metadata.yaml does not name other.mcap; .* reindex"), BagReader(bag):
        pass


def test_metadata_that_name_a_file_that_is_missing_end_reading(tmp_path: Path) -> None:
    bag = closed(tmp_path / "bag")
    whole = read(bag)
    found = read(changed(bag, "paths:\n  - bag.mcap", "paths:\n  - lost.mcap"))
    assert found.messages == whole.messages
    assert "lost.mcap" in found.fault and "the 30 messages of its storage were used; write it anew" in found.fault


def test_a_part_that_is_missing_is_to_be_put_back_and_not_left_out_of_the_metadata(tmp_path: Path) -> None:
    bag = closed(tmp_path / "bag")
    whole = read(bag)
    found = read(changed(bag, "paths:\n  - bag.mcap", "paths:\n  - bag.mcap\n  - bag_1.mcap"))
    assert found.messages == whole.messages
    assert "bag_1.mcap missing, of the files in metadata.yaml; the 30 messages of the others were used" in found.fault
    assert "reindex" not in found.fault


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("  message_count: 30\n", "  message_count: 31\n", "tells 31 messages in place of 30;"),
        (
            "- message_count: 15\n",
            "- message_count: 14\n",
            "tells 14 on /one in place of 15, 14 on /other in place of 15;",
        ),
        ("name: /one", "name: /ore", "tells 0 on /one in place of 15, 15 on /ore in place of 0;"),
        (TEXT, "std_msgs/msg/Strino", f"tells std_msgs/msg/Strino on /one in place of {TEXT}, "),
    ],
)
def test_metadata_that_tell_otherwise_than_the_storage_are_named_and_the_storage_is_read(
    tmp_path: Path, old: str, new: str, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = closed(tmp_path / "bag")
    whole = read(bag)
    assert read(changed(bag, old, new)) == whole
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"{bag}: metadata.yaml {told}") and line.endswith(
        "the storage is used; write it anew with ros2 bag reindex"
    )


def test_another_quality_of_service_in_metadata_drops_no_message(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        writer.write_raw("/initialpose", TEXT, text("text"), 1)
    whole = read(tmp_path / "bag")
    assert len(whole.messages) == 1
    assert read(changed(tmp_path / "bag", "depth: 1", "depth: 3")) == whole


def test_storage_files_are_read_in_the_order_of_metadata(tmp_path: Path) -> None:
    """As rosbag2 numbers them: bag_10 comes after bag_9, not after bag_1."""
    bag = tmp_path / "bag"
    for name, stamp in (("bag_9", 1), ("bag_10", 2)):
        with BagWriter(tmp_path / name) as writer:
            writer.write_raw("/one", TEXT, text(name), stamp)
    shutil.move(tmp_path / "bag_9", bag)
    shutil.move(tmp_path / "bag_10" / "bag_10.mcap", bag)
    changed(bag, "message_count: 1", "message_count: 2")
    changed(bag, "paths:\n  - bag_9.mcap", "paths:\n  - bag_9.mcap\n  - bag_10.mcap")
    assert [message.stamp_ns for message in read(bag).messages] == [1, 2]
