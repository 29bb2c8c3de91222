"""Bags of somebody else: rooms that are driven through once, and what detectors of other makers say of them."""

import argparse
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

import yaml

from semantic_slam.datasets.user_bag import user_bag_import
from semantic_slam_lab.simulation.detectors.detector_bag import write_detector_bag
from semantic_slam_lab.simulation.detectors.detector_boxes import BoxFaults
from semantic_slam_lab.simulation.detectors.detector_words import BY_CHANCE, BY_SIDE, BY_VIEW, NAMES, DetectorFaults

IMAGE_WIDTH = 720
"""Pixels; that of the shipped bag."""
ODOMETRY_SEEDS = {0: 2}
"""Room 0 is the one of the shipped bag, with its odometry; others draw theirs by their own number."""
LINES = {
    "by chance": DetectorFaults(confusion=BY_CHANCE),
    "by view": DetectorFaults(confusion=BY_VIEW),
    "by side": DetectorFaults(confusion=BY_SIDE),
    "torn boxes": DetectorFaults(boxes=BoxFaults(doubled=0.2, split=0.05, merged=0.1)),
}
"""How the detector confuses one box in five; three hypotheses a box, 15 % missed, a false alarm in ten frames.

With torn boxes, one thing in five has two boxes with different names, and some are split or merged.
"""


@dataclass(frozen=True, kw_only=True)
class Case:
    """One bag."""

    line: str
    room: int
    draw: int  # keys what is missed, confused and made up
    detector: int  # keys what it confuses by view or by side


def room_bag(number: int, folder: Path) -> Path:
    """The bag of a drive through a room, with its ground truth; rendered into ``folder`` where that has it not yet."""
    from semantic_slam.datasets.avd.avd_import import import_avd
    from semantic_slam.datasets.avd.drive import ImportSettings
    from semantic_slam_lab.simulation.scene import SceneSettings, make_scene

    bag = folder / f"room_{number}"
    if not bag.exists():
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=folder) as scenes:
            scene = make_scene(Path(scenes), number, SceneSettings(tour_only=True))
            seed = ODOMETRY_SEEDS.get(number, number)
            import_avd(scene, Path(scenes) / bag.name, None, None, seed, ImportSettings(image_width=IMAGE_WIDTH))
            (Path(scenes) / bag.name).rename(bag)
    return bag


def foreign_bag(case: Case, room: Path, folder: Path) -> Path:
    """The bag as its owner recorded it."""
    bag = folder / "foreign"
    key = (list(LINES).index(case.line), case.room, case.draw)
    write_detector_bag(room, bag, LINES[case.line], seed=key, detector=case.detector)
    return bag


def imported(foreign: Path, bag: Path, labels: Path | None = None) -> Path:
    """``import_dataset bag FOREIGN --out BAG [--labels YAML]``; returns ``bag``."""
    parser = argparse.ArgumentParser()
    user_bag_import.add_arguments(parser)
    words = [str(foreign), "--out", str(bag), *(("--labels", str(labels)) if labels else ())]
    with redirect_stdout(StringIO()):
        user_bag_import.run(parser.parse_args(words), bag)
    return bag


def classifier_labels(folder: Path) -> Path:
    """What the user has to write for the shipped classifier: its names for the detector's, "object" for the others."""
    mapping = dict.fromkeys(DetectorFaults().names, "object") | {theirs: ours for ours, theirs in NAMES.items()}
    file = folder / "labels.yaml"
    file.write_text(yaml.safe_dump(mapping))
    return file
