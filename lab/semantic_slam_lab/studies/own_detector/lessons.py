"""What other bags teach of a detector: by their runs alone, and by who is who there, as turntables would tell."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from semantic_slam.training.labels.learn import RunTracks, learn
from semantic_slam.training.labels.maximisation import class_shares
from semantic_slam.training.labels.tracks import Track
from semantic_slam.training.runs import Run, read_runs
from semantic_slam.viewpoint.labels.store import FittedLabels, save_labels
from semantic_slam_lab.studies.own_detector.bags import Case, foreign_bag, imported
from semantic_slam_lab.studies.own_detector.courses import Drive
from semantic_slam_lab.studies.own_detector.methods import DETECTOR_CONFIGURATION, drive

FITTED, TAUGHT = "fitted", "taught"
"""From beliefs alone, and with the true class of every object."""
CERTAIN = 50.0
"""Nats between a true class and all others."""


def teaching_run(line: str, room: int, draw: int, detector: int, bag: Path, folder: Path) -> Path:
    """Folder of the report of a run out of the box on a bag that only teaches."""
    place = folder / f"{line.replace(' ', '_')}_{room}"
    place.mkdir(parents=True)
    case = Case(line=line, room=room, draw=draw, detector=detector)
    drive(imported(foreign_bag(case, bag, place), place / "bag"), place / "report", DETECTOR_CONFIGURATION)
    return place / "report"


def learned(folders: Sequence[Path], out: Path) -> Mapping[str, Path]:
    """Method -> file of models, in the folder ``out``."""
    told = RunTracks.of(read_runs(folders))
    files = {name: out / f"{name}.safetensors" for name in (FITTED, TAUGHT)}
    save_labels(learn(told), files[FITTED])
    save_labels(taught(told), files[TAUGHT])
    return files


def taught(told: RunTracks) -> FittedLabels:
    """From the same views, of objects whose classes are known; those of no true object are left out."""
    labels = told.settings.labels
    tracks = [_true(run, own, labels) for run, own in zip(told.runs, told.tracks, strict=True)]
    objects = np.sum(
        [np.exp(track.log_prior) for own in tracks for track in own if track.log_prior is not None], axis=0
    )
    return replace(learn(replace(told, tracks=tracks)), class_shares=class_shares(objects))


def _true(run: Run, tracks: Sequence[Track], labels: tuple[str, ...]) -> list[Track]:
    truth = Drive(run.record)
    class_of = {number: truth.true_classes[true] for true, number in truth.matches.items()}
    known = [(track, class_of[track.object_id]) for track in tracks if track.object_id in class_of]
    return [
        replace(track, log_prior=np.where(np.arange(len(labels) + 1) == labels.index(name), 0.0, -CERTAIN))
        for track, name in known
    ]
