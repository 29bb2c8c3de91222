"""A recording of several files of which one is missing: what lay in it is counted as dropped, by topic."""

from collections import Counter
from pathlib import Path

import pytest
import rclpy
import yaml
from worlds.bags.bag_factory import Entry, write_bag, write_configuration
from worlds.bags.places import place_entries

from semantic_slam.configuration import Configuration, load_configuration
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.messages import topics
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.ros.bag_player import BagPlayer

pytestmark = pytest.mark.slow

NUM_FRAMES = 8


@pytest.fixture
def configuration(tmp_path: Path) -> Configuration:
    return load_configuration(write_configuration(tmp_path / "configuration", perception={"network": "nowhere"}))


def split_bag(folder: Path, entries: list[Entry], cut: int) -> Path:
    """A bag of two files, of which the second begins with the entry of number ``cut``."""
    metadata = yaml.safe_load((write_bag(folder, entries) / "metadata.yaml").read_text())
    (whole,) = folder.glob("*.mcap")
    whole.unlink()
    names = [f"{whole.stem}_{number}.mcap" for number in range(2)]
    for name, part in zip(names, (entries[:cut], entries[cut:]), strict=True):
        (written,) = write_bag(folder.with_name(name), part).glob("*.mcap")
        written.rename(folder / name)
    metadata["rosbag2_bagfile_information"]["relative_file_paths"] = names
    (folder / "metadata.yaml").write_text(yaml.safe_dump(metadata))
    return folder


def counts(entries: list[Entry]) -> dict[str, int]:
    """By reason; ground truth is no input."""
    sent = Counter(entry.topic for entry in entries if entry.topic in (topics.ODOMETRY, topics.DETECTIONS))
    return {f"{topic}: in a file that is missing": number for topic, number in sent.items()}


def test_messages_of_a_missing_part_are_counted_as_dropped(tmp_path: Path, configuration: Configuration) -> None:
    entries = place_entries("ranges", NUM_FRAMES)
    cut = next(n for n, entry in enumerate(entries) if entry.stamp_ns == entries[-1].stamp_ns) - 3
    bag = split_bag(tmp_path / "bag", entries, cut)
    whole = run_bag(bag, tmp_path / "whole", configuration)
    assert whole.fault is None and not whole.dropped

    (bag / "bag_1.mcap").unlink()
    summary = run_bag(bag, tmp_path / "part", configuration)
    assert 0 < summary.num_keyframes < whole.num_keyframes and "bag_1.mcap missing" in str(summary.fault)
    assert summary.dropped == read_record(tmp_path / "part").dropped == counts(entries[cut:])


def test_a_run_that_ends_before_the_missing_part_lacks_nothing(tmp_path: Path, configuration: Configuration) -> None:
    entries = place_entries("ranges", NUM_FRAMES)
    bag = split_bag(tmp_path / "bag", entries, len(entries) - 1)
    (bag / "bag_1.mcap").unlink()
    summary = run_bag(bag, tmp_path / "belief", configuration, max_keyframes=2)
    assert summary.num_keyframes == 2 and summary.fault is None and not summary.dropped


def test_a_first_part_that_is_missing_is_told_however_early_the_run_ends(
    tmp_path: Path, configuration: Configuration, capsys: pytest.CaptureFixture[str]
) -> None:
    entries = place_entries("ranges", NUM_FRAMES)
    second = next(n for n, entry in enumerate(entries) if entry.stamp_ns > entries[0].stamp_ns)
    bag = split_bag(tmp_path / "bag", entries, second)
    (bag / "bag_0.mcap").unlink()
    summary = run_bag(bag, tmp_path / "belief", configuration, max_keyframes=2)
    assert summary.num_keyframes == 2 and summary.fault is None
    assert summary.dropped == read_record(tmp_path / "belief").dropped == counts(entries[:second])
    assert f"{bag}: bag_0.mcap missing, of the files in metadata.yaml; put" in capsys.readouterr().out


@pytest.mark.ros
@pytest.mark.parametrize("part", [0, 1])
def test_a_player_counts_and_tells_what_is_missing(tmp_path: Path, part: int) -> None:
    entries = place_entries("ranges", NUM_FRAMES)
    cut = len(entries) // 2
    bag = split_bag(tmp_path / "bag", entries, cut)
    (bag / f"bag_{part}.mcap").unlink()
    words = ("-p", f"bag:={bag}", "-p", "rate:=1e6", "-p", "wait_for_listeners_s:=0.0")
    rclpy.init(args=["--ros-args", *words])
    try:
        player = BagPlayer()
        player.resume()
        while player.fault is None:
            rclpy.spin_once(player, timeout_sec=0.05)
        assert f"bag_{part}.mcap missing" in str(player.fault)
        assert player.refused == counts(entries[:cut] if part == 0 else entries[cut:])
        player.worker.stop()
        player.destroy_node()
    finally:
        rclpy.try_shutdown()
