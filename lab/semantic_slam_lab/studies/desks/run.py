"""One walk about the desks: imported, mapped and compared with what stands there."""

import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from semantic_slam.configuration import Configuration, load_configuration
from semantic_slam.datasets.space.drive import write_spatial_drive
from semantic_slam.datasets.tum_rgbd.folder import read_tum_folder
from semantic_slam.datasets.tum_rgbd.tum_rgbd_import import of_camera, read_drive
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.evaluation.evaluate import evaluate
from semantic_slam.geometry.arrays import Array
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.shipped import configuration_file
from semantic_slam_lab.repetitions import keyed_generator
from semantic_slam_lab.simulation.desks import Office, write_office

EXISTS, NEAR_M = 0.5, 0.25
"""Existence from which on an object counts as stated, and how far from the middle of a thing it may be."""


@dataclass(frozen=True, kw_only=True)
class Walked:
    """What came of one walk."""

    seed: int
    drift: float
    things: int
    found: int  # things that an object of its own is near
    false: int  # objects that are near none
    named_right: int  # of those found
    f1: float  # of pairs of detections
    f1_annotated: float  # of pairs of detections that are of a thing
    ate_m: float
    odometry_ate_m: float
    nees: float  # mean over keyframes, of 6 degrees of freedom
    keyframes: int
    cpu_s: float
    times_real: float  # seconds of the walk per second of CPU


def configuration(seed: int) -> Configuration:
    """The shipped one for space."""
    return replace(load_configuration(configuration_file("spatial")), seed=seed)


def walked(seed: int, drift: float, office: Office) -> Walked:
    """Draw an office, walk, map, compare."""
    with tempfile.TemporaryDirectory(prefix="desks_") as place:
        source, bag, beliefs = (Path(place) / name for name in ("source", "bag", "beliefs"))
        write_office(source, office, keyed_generator("desks", seed))
        folder = read_tum_folder(source)
        drive = read_drive(folder, drift, seed)
        write_spatial_drive(drive, bag, "desks", others=of_camera(folder, drive))
        began = time.process_time()
        run_bag(bag, beliefs, configuration(seed))
        spent = time.process_time() - began
        record = read_record(beliefs)
    assert record.truth is not None and record.truth.objects is not None
    metrics, last = evaluate(record, record.truth).metrics, record.beliefs[-1]
    rows, there = np.flatnonzero(last.existence > EXISTS), record.truth.objects
    pairs = nearest(last.object_poses[rows, :3], there.poses[:, :3])
    names = [last.class_names[best] for best in last.class_probabilities[rows].argmax(axis=1)]
    return Walked(
        seed=seed,
        drift=drift,
        things=len(there.object_ids),
        found=len(pairs),
        false=len(rows) - len(pairs),
        named_right=sum(names[own] == there.class_names[true] for true, own in pairs.items()),
        f1=float(metrics["association_f1"] or 0.0),
        f1_annotated=float(metrics["association_f1_annotated"] or 0.0),
        ate_m=float(metrics["ate_m"] or np.nan),
        odometry_ate_m=float(metrics["dead_reckoning_ate_m"] or np.nan),
        nees=float(metrics["nees_mean"] or np.nan),
        keyframes=len(record.beliefs),
        cpu_s=spent,
        times_real=office.seconds / spent,
    )


def nearest(stated: Array, there: Array) -> dict[int, int]:
    """Row of a thing -> row of the object that is stated near it, one to one."""
    if not len(stated):
        return {}
    away = np.linalg.norm(there[:, None] - stated[None], axis=2)
    cost = np.where(away <= NEAR_M, away, 1e3)
    rows, columns = linear_sum_assignment(cost)
    return {int(row): int(column) for row, column in zip(rows, columns, strict=True) if cost[row, column] < 1e3}
