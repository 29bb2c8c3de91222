"""A recording of several files of which one is missing: what lay in it is counted as dropped, by topic."""

from collections import Counter
from pathlib import Path

import pytest
import yaml
from worlds.bags.bag_factory import Entry, write_bag, write_configuration
from worlds.bags.places import place_entries

from semantic_slam.configuration import Configuration, load_configuration
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.messages import topics
from semantic_slam.pipeline.offline import run_bag

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
