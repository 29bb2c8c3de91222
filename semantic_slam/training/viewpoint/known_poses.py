"""A bag whose poses are known, as data for viewpoint models: what the classifier says of each class from where."""

from collections import Counter, defaultdict
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.spatial.transform import Rotation

from semantic_slam.configuration import Configuration, PerceptionConfiguration, SemanticModelConfiguration
from semantic_slam.errors import InputError
from semantic_slam.evaluation.record import GroundTruth, Record
from semantic_slam.evaluation.trajectory import interpolate
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.training.viewpoint.samples import ClassSamples

LEAST_VIEWS = 8
"""Views of a class from which on a model is fitted to it."""


def views_of_bag(bag: Path, perception: PerceptionConfiguration) -> tuple[dict[str, ClassSamples], dict[str, int]]:
    """Samples of every class by name, and what was left out with counts.

    The bag needs images, detections, ``/ground_truth/odom``, ``/ground_truth/objects`` and
    ``/ground_truth/associations``. Raises InputError naming the one that is missing.
    """
    from semantic_slam.evaluation.belief_bag import read_record

    configuration = Configuration(
        association="given", semantic_model=SemanticModelConfiguration(kind="none"), perception=perception
    )
    with TemporaryDirectory() as folder:
        summary = run_bag(bag, Path(folder) / "measured", configuration, map_prior=MapPrior())
        record = read_record(summary.belief_bag)
    samples, left_out = samples_of(record, str(bag))
    return samples, left_out | summary.dropped


def samples_of(record: Record, origin: str) -> tuple[dict[str, ClassSamples], dict[str, int]]:
    """One view, one direction: a camera that moves sees none twice. Raises InputError."""
    truth = _complete(record.truth, origin)
    assert truth.objects is not None
    known = dict(
        zip(truth.objects.object_ids, zip(truth.objects.class_names, truth.objects.poses, strict=True), strict=True)
    )
    seen: dict[str, list[tuple[float, SemanticMeasurements, int]]] = defaultdict(list)
    left_out: Counter[str] = Counter()
    for stamp, measurements in record.measurements.items():
        body = interpolate(truth.trajectory, np.array([stamp]))[0]
        names = truth.associations.get(stamp)
        for row, index in enumerate(measurements.detection_ids):
            name = names[index] if names is not None and index < len(names) else ""
            if name not in known or not np.isfinite(body).all():
                left_out["views: no known object or pose"] += 1
                continue
            class_name, pose = known[name]
            seen[class_name].append((_azimuth(body, pose, measurements.sensor_position), measurements, row))
    samples = {}
    for class_name, views in sorted(seen.items()):
        if len(views) < LEAST_VIEWS:
            left_out[f"views: fewer than {LEAST_VIEWS} of class '{class_name}'"] += len(views)
        else:
            samples[class_name] = _stacked(views)
    if not samples:
        raise InputError(f"{origin}: no class has {LEAST_VIEWS} views with known poses; record more views")
    return samples, dict(left_out)


def _complete(truth: GroundTruth | None, origin: str) -> GroundTruth:
    missing = "/ground_truth/odom" if truth is None or not len(truth.trajectory) else ""
    if truth is not None and not missing:
        missing = "/ground_truth/objects" if truth.objects is None else ""
        missing = missing or ("" if truth.associations else "/ground_truth/associations")
    if truth is None or missing:
        raise InputError(f"{origin}: no {missing}; models are fitted from bags whose poses and objects are known")
    return truth


def _azimuth(body: Array, target: Array, sensor: Array) -> float:
    """Azimuth [rad] of the camera in the object's frame; poses (7,) in map, ``sensor`` (3,) in the body frame."""
    camera = body[:3] + Rotation.from_quat(body[3:]).apply(sensor)
    direction = Rotation.from_quat(target[3:]).inv().apply(camera - target[:3])
    return float(np.arctan2(direction[1], direction[0]))


def _stacked(views: list[tuple[float, SemanticMeasurements, int]]) -> ClassSamples:
    ordered = sorted(views, key=lambda view: view[0])
    return ClassSamples(
        np.array([azimuth for azimuth, _, _ in ordered]),
        np.stack([measurements.features[row] for _, measurements, row in ordered])[:, None],
        np.stack([measurements.feature_covariances[row] for _, measurements, row in ordered])[:, None],
        stamps_ns=np.array([measurements.stamp_ns for _, measurements, _ in ordered], dtype=np.int64),
    )
