"""What is run on a bag: the detector's labels as evidence, and class models from turntables in their place."""

from collections.abc import Callable, Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import yaml

from semantic_slam.cli import bag_to_report
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.shipped import configuration_file
from semantic_slam_lab.simulation.detectors.detector_words import NAMES
from semantic_slam_lab.studies.own_detector.bags import classifier_labels, imported
from semantic_slam_lab.studies.own_detector.courses import Drive

OURS = "ours"
DETECTOR_CONFIGURATION = "detector"
TURNTABLE_CONFIGURATION = "open_world"


@dataclass(frozen=True, kw_only=True)
class Driven:
    """A drive by one method, and what its classes are called in the detector's words."""

    drive: Drive
    names: Mapping[str, str]


def drive(bag: Path, out: Path, configuration: str | Path) -> Path:
    """``bag_to_report BAG --out OUT --config CONFIGURATION`` without a map; returns the bag of beliefs."""
    words = [str(bag), "--out", str(out), "--config", str(configuration)]
    with redirect_stdout(StringIO()):
        bag_to_report.report(bag_to_report.parse(words), out)
    return out / "belief"


def by_labels(foreign: Path, folder: Path) -> Driven:
    """The two commands of somebody who has a detector, and nothing trained."""
    bag = imported(foreign, folder / "bag")
    record = read_record(drive(bag, folder / "report", DETECTOR_CONFIGURATION))
    return Driven(drive=Drive(record), names={})


def by_turntables(foreign: Path, folder: Path) -> Driven:
    """The shipped classifier and its viewpoint models, taught by turntables of this furniture; labels only select."""
    bag = imported(foreign, folder / "bag", classifier_labels(folder))
    record = read_record(drive(bag, folder / "report", TURNTABLE_CONFIGURATION))
    return Driven(drive=Drive(record), names=NAMES)


def by_models(foreign: Path, folder: Path, models: Path) -> Driven:
    """The shipped configuration of a detector, with label models fitted on other bags."""
    settings = yaml.safe_load(configuration_file(DETECTOR_CONFIGURATION).read_text(encoding="utf-8"))
    settings["/**"]["ros__parameters"]["semantic_model"]["path"] = str(models)
    configuration = folder / "fitted.yaml"
    configuration.write_text(yaml.safe_dump(settings), encoding="utf-8")
    bag = imported(foreign, folder / "bag")
    return Driven(drive=Drive(read_record(drive(bag, folder / "report", configuration))), names={})


METHODS: dict[str, Callable[[Path, Path], Driven]] = {OURS: by_labels, "gp_independent": by_turntables}
"""Name -> what makes a drive of a foreign bag in an empty folder."""
