"""What a file or message claims is checked before anybody acts on it: a line or a count, and never a gigabyte."""

import json
import resource
import struct
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import zstandard
from worlds.bags.bag_factory import HEIGHT, WIDTH, compressed, input_entries, map_prior, of_topic, write_bag
from worlds.bags.mistakes import each, scored
from worlds.belief_factory import small_belief
from worlds.hostile_pictures import png_that_claims, png_with_a_chunk_of

from semantic_slam.bag.chunk_limits import LARGEST_CHUNK
from semantic_slam.bag.mcap_stream import McapStream
from semantic_slam.bag.reader import BagReader
from semantic_slam.bag.writer import BagWriter
from semantic_slam.cli.exit_codes import exit_code
from semantic_slam.configuration import from_dict, load_configuration
from semantic_slam.datasets.user_bag.label_map import read_label_map
from semantic_slam.errors import InputError, MessageError
from semantic_slam.inference.world.map_prior import parse_map_prior, read_map_prior
from semantic_slam.messages import topics
from semantic_slam.messages.image_size import claimed_size
from semantic_slam.messages.images import decode_depth, decode_image
from semantic_slam.messages.standard import PoseEstimate
from semantic_slam.outputs import write_whole
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.perception.usable_measurements import NO_SCORES, usable, with_scores
from semantic_slam.pipeline.assembly.frame_assembler import FrameAssembler
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.pipeline.preamble import checked_initial_pose


@pytest.mark.parametrize("kind", [".png", ".jpg"])
@pytest.mark.parametrize("shape", [(24, 32), (1, 700), (333, 2)])
def test_the_size_is_read_without_decoding(kind: str, shape: tuple[int, int]) -> None:
    data = cv2.imencode(kind, np.zeros((*shape, 3), np.uint8))[1].tobytes()
    assert claimed_size(data) == shape[::-1]
    assert claimed_size(data[:10]) is None


def test_a_picture_that_claims_sixty_thousand_pixels_each_way_is_refused_at_once() -> None:
    bomb = np.frombuffer(png_that_claims(60_000, 60_000), np.uint8)
    with pytest.raises(MessageError, match="image: an image that claims more than 100000000 pixels"):
        decode_image(compressed(1, "png", bomb), "image")
    with pytest.raises(MessageError, match="depth: an image that claims more"):
        decode_depth(compressed(1, "16UC1; png", bomb), "depth")


@pytest.mark.parametrize("length", [2**32 - 7, 2**31 - 1, 5000])
def test_a_png_with_a_chunk_that_is_longer_than_the_file_is_never_decoded(
    length: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For which a decoder makes room: four gigabytes, and seconds, for a picture of 32 x 24."""
    longer = np.frombuffer(png_with_a_chunk_of(length), np.uint8)
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("decoded"))
    assert claimed_size(longer.tobytes()) is None
    with pytest.raises(MessageError, match="image"):
        decode_image(compressed(1, "png", longer), "image")
    with pytest.raises(MessageError, match="depth"):
        decode_depth(compressed(1, "16UC1; png", longer), "depth")


def test_a_picture_of_another_size_than_the_cameras_is_never_decoded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("decoded"))
    assembler, entries = FrameAssembler(from_dict({}), has_depth=False), input_entries(1)
    assembler.add_camera_info(of_topic(entries, topics.CAMERA_INFO)[0].message)
    assembler.add_detections(of_topic(entries, topics.DETECTIONS)[0].message)
    stamp = of_topic(entries, topics.DETECTIONS)[0].stamp_ns
    assembler.add_image(compressed(stamp, "png", np.frombuffer(png_that_claims(9000, 9000), np.uint8)))
    assert assembler.flush() == []
    assert assembler.dropped == {f"image: size 9000 x 9000 is not the {WIDTH} x {HEIGHT} of camera_info": 1}


def bomb_of(bag: Path) -> Path:
    """The bag with a chunk more, of kilobytes that claim gigabytes."""
    path = next(bag.glob("*.mcap"))
    content = zstandard.ZstdCompressor(write_content_size=True).compress(bytes(LARGEST_CHUNK + 1))
    chunk = struct.pack("<QQQII", 0, 1, LARGEST_CHUNK + 1, 0, 4) + b"zstd" + struct.pack("<Q", len(content)) + content
    data = path.read_bytes()
    path.write_bytes(data[:8] + struct.pack("<BQ", 6, len(chunk)) + chunk + data[8:])
    return path


def test_a_chunk_that_claims_more_than_any_recorder_writes_is_refused(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", input_entries(1))
    path = bomb_of(bag)
    assert path.stat().st_size < 100_000
    for place in (bag, path):
        with pytest.raises(InputError, match="a chunk claims more than 256 MiB"), BagReader(place):
            pass


def test_a_chunk_gives_no_more_than_it_says(tmp_path: Path) -> None:
    content = zstandard.ZstdCompressor().compress(bytes(50 << 20))
    chunk = struct.pack("<QQQII", 0, 1, 1000, 0, 4) + b"zstd" + struct.pack("<Q", len(content)) + content
    path = tmp_path / "bomb.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + struct.pack("<BQ", 6, len(chunk)) + chunk)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert McapStream(path).counts.total() == 0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 20 << 10


ALIASES = "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{new}: &{new} [{','.join([f'*{old}'] * 9)}]\n" for old, new in zip("abcdefgh", "bcdefghi", strict=True)
)


@pytest.mark.long
@pytest.mark.parametrize("read", [load_configuration, read_label_map])
@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (ALIASES.encode(), "YAML aliases"),
        (b"\xff\xfe\x00", "no text in UTF-8"),
        (b"a: " + b"[" * 1200, "not a readable YAML file"),
        (b"a: 2024-99-99", "not a readable YAML file"),
        (b"\x00", "not a readable YAML file"),
    ],
)
def test_a_hostile_yaml_file_is_one_line(tmp_path: Path, read: object, content: bytes, reason: str) -> None:
    path = tmp_path / "file.yaml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=reason) as refused:
        read(path)  # type: ignore[operator]
    assert str(refused.value).startswith(f"{path}: ") and len(str(refused.value)) < 400


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("/**:\n  ros__parameters: {seed: 1}\n  pruning: {ratio: 9}\n", "'pruning' stands beside 'ros__parameters'"),
        ("/**:\n  ros__parameters: {seed: 1}\npruning: {ratio: 9}\n", r"'pruning' stands beside '/\*\*'"),
        ("hypothesis_manager:\n  ros__parameters: {backends: 2}\n", "of a node alone .* into another file"),
        ("/**:\n  ros__parameters: {seed: 1}\nclassifier:\n  ros__parameters: {seed: 2}\n", "'classifier' stands"),
    ],
)
def test_parameters_that_nobody_would_read_are_refused(tmp_path: Path, text: str, reason: str) -> None:
    path = tmp_path / "file.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=reason):
        load_configuration(path)


def test_parameters_of_other_peoples_nodes_may_stand_beside_ours(tmp_path: Path) -> None:
    path = tmp_path / "file.yaml"
    path.write_text("/**:\n  ros__parameters: {seed: 7}\ncamera_driver:\n  ros__parameters: {rate: 30}\n")
    assert load_configuration(path).seed == 7


@pytest.mark.parametrize("value", [float("nan"), -5, 1.5, "many", None, 10**400])
@pytest.mark.parametrize("name", ["existence", "id", "pose", "covariance", "class_probabilities"])
def test_an_impossible_value_in_a_map_is_one_line(name: str, value: object) -> None:
    document = json.loads(map_prior().to_json())
    document["objects"][0][name] = value
    if (name, value) in (("class_probabilities", None),):
        return
    with pytest.raises(InputError, match=r"objects.json: not a map prior") as refused:
        parse_map_prior(json.dumps(document), "objects.json")
    assert len(str(refused.value)) < 400


def test_a_map_that_is_no_text_or_nested_without_end_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "objects.json"
    for content in (b"\xff\xff", b"[" * 200_000):
        path.write_bytes(content)
        with pytest.raises(InputError, match=str(path)):
            read_map_prior(path)


@pytest.mark.parametrize(
    "covariance",
    [np.zeros((6, 6)), -np.eye(6), np.full((6, 6), np.nan), np.diag([1.0, 1, 0, 0, 0, 0]), np.ones((6, 6))],
)
def test_an_initial_pose_without_a_covariance_is_refused(covariance: np.ndarray) -> None:
    estimate = PoseEstimate(1, "map", np.array([0.0, 0, 0, 0, 0, 0, 1]), covariance)
    with pytest.raises(MessageError, match="initialpose"):
        checked_initial_pose(estimate, "map")


def test_an_initial_pose_as_rviz_publishes_it_is_taken() -> None:
    covariance = np.diag([0.25, 0.25, 0.0, 0.0, 0.0, 0.0685])
    estimate = PoseEstimate(1, "map", np.array([1.0, 2.0, 0, 0, 0, 0, 2.0]), covariance)
    assert checked_initial_pose(estimate, "map").pose[6] == 1.0


def measured(count: int) -> SemanticMeasurements:
    return SemanticMeasurements(
        stamp_ns=1, sequence=0, frame_id="base_link", class_names=("a",),
        detection_ids=np.arange(count, dtype=np.uint32), boxes=np.zeros((count, 4)), labels=("x",) * count,
        scores=np.ones(count), track_ids=("",) * count, class_probability_samples=np.ones((count, 2, 1)),
        features=np.ones((count, 1)), feature_covariances=np.ones((count, 1, 1)),
        predictive_entropy=np.zeros(count), mutual_information=np.zeros(count), ranges_m=np.ones(count),
        bearings_rad=np.zeros(count), geometric_covariances=np.tile(np.eye(2), (count, 1, 1)),
        sensor_position=np.zeros(3), in_coverage=np.ones(count, bool),
    )  # fmt: skip


@pytest.mark.parametrize("name", ["features", "feature_covariances", "bearings_rad", "class_probability_samples"])
def test_one_detection_that_is_no_measurement_costs_that_detection(name: str) -> None:
    dropped: Counter[str] = Counter()
    good = measured(3)
    assert usable(good, "topic", dropped) is good and not dropped
    array = getattr(good, name).copy()
    array[1] = np.nan
    assert usable(replace(good, **{name: array}), "topic", dropped).detection_ids.tolist() == [0, 2]
    assert dropped.total() == 1 and all(reason.startswith("topic: ") for reason in dropped)


def test_bearings_alone_and_places_without_a_covariance_are_measurements() -> None:
    good = measured(2)
    alone = np.diag([np.nan, 0.01])
    bearing = replace(
        good, ranges_m=np.array([np.nan, 2.0]), geometric_covariances=np.array([alone, np.eye(2) * np.nan])
    )
    assert len(usable(bearing, "topic", Counter())) == 2


@pytest.mark.parametrize("wrong", [88.7, -1.0, 5.2, -0.1, 1.01])
def test_scores_that_are_no_probabilities_count_as_not_told(wrong: float) -> None:
    dropped: Counter[str] = Counter()
    good = replace(
        measured(3), class_names=("a", "b"), class_scores=np.array([[0.9, np.nan], [wrong, 0.2], [0.0, 1.0]])
    )
    assert with_scores(good, "topic", dropped, of_classes=False) is good and not dropped
    found = with_scores(replace(good, scores=np.array([0.5, wrong, np.nan])), "topic", dropped, of_classes=True)
    np.testing.assert_array_equal(found.scores, [0.5, np.nan, np.nan])
    np.testing.assert_array_equal(found.class_scores, [[0.9, np.nan], [np.nan, np.nan], [0.0, 1.0]])
    assert dropped == {f"topic: {NO_SCORES}": 1}


def test_a_score_of_one_in_single_precision_is_one() -> None:
    dropped: Counter[str] = Counter()
    rounded = replace(measured(2), scores=np.array([1.0 + 1e-6, -1e-7]))
    found = with_scores(rounded, "topic", dropped, of_classes=False)
    assert found.scores.tolist() == [1.0, 0.0] and not dropped


@pytest.mark.filterwarnings("error")
def test_a_run_of_scores_in_per_cent_goes_without_a_warning_and_says_so(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", each(topics.DETECTIONS, scored(80.0))(input_entries(6)))
    values = {"semantic_model": {"kind": "detector"}, "association": "open", "open_world": {"learn_alarm_scores": True}}
    assert run_bag(bag, tmp_path / "out", from_dict(values)).dropped == {f"/classifier/measurements: {NO_SCORES}": 12}


@pytest.fixture
def full_disk() -> Iterator[None]:
    """Files of this process may not grow beyond 64 kB."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 16, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.usefixtures("full_disk")
def test_a_full_disk_is_one_line_and_what_was_flushed_stays(tmp_path: Path) -> None:
    chance = np.random.default_rng(0)
    with (
        pytest.raises(InputError, match=r"bag: cannot be written \(File too large\)"),
        BagWriter(tmp_path / "bag") as writer,
    ):
        for k in range(10_000):
            belief = small_belief(k, [1], [1], [1.0], [4], [[4]])
            noise = chance.normal(size=belief.poses.shape)
            writer.write(topics.BELIEF, replace(belief, poses=belief.poses + noise), 1 + k)
            writer.flush()
    with BagReader(tmp_path / "bag") as reader:
        given = [message.stamp_ns for message in _until_damage(reader)]
    assert len(given) > 5 and given == list(range(1, 1 + len(given)))


def _until_damage(reader: BagReader) -> Iterator[object]:
    try:
        yield from reader.messages()
    except InputError:
        return


def test_a_text_is_there_whole_or_not_at_all(
    tmp_path: Path, full_disk: None, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "report.html"
    path.write_text("old")
    assert exit_code(lambda: write_whole(path, "x" * (1 << 17))) == 1
    assert path.read_text() == "old" and [item.name for item in tmp_path.iterdir()] == ["report.html"]
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith("File too large; make room, and run it again")
    assert sys.exc_info() == (None, None, None)
