"""Drives through rendered rooms of identical furniture: the network's measurements, with misses and false alarms added.

A room is rendered and measured once; what is missed and what is false is drawn anew for every run, by its own key.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from semantic_slam.configuration import Configuration, OdometryConfiguration, SemanticModelConfiguration
from semantic_slam.evaluation.record import Record
from semantic_slam.evaluation.trajectory import interpolate
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import (
    covariance_from_planar,
    planar_from_covariance,
    planar_from_pose_vector,
    pose_vector_from_planar,
)
from semantic_slam.geometry.rows import joined_rows
from semantic_slam.geometry.transform import between
from semantic_slam.inference.inputs.keyframe import Keyframe, OdometrySample
from semantic_slam.perception.measurement import OF_THE_FRAME, SemanticMeasurements
from semantic_slam.pipeline.odometry.motion import OdometryPoint, motion_covariance, start
from semantic_slam_lab.simulation.mujoco_scene import PlacedObject

IMAGE_WIDTH = 720
"""Pixels; that of the shipped bag."""
CLUTTER = ""
"""True object of a false alarm."""
ALARM_RANGE_M = (0.8, 4.5)
ALARM_FIELD_OF_VIEW_RAD = 1.3
"""Where false alarms lie, evenly on the ground: where the detector finds objects."""

NO_MOTION = covariance_from_planar(1e-8 * np.eye(3))


@dataclass(frozen=True)
class Rates:
    """What is done to a drive."""

    clutter: float  # share of all detections that is false, on average
    misses: float  # share of the true detections that is dropped, on average
    odometry: OdometryConfiguration = field(default_factory=OdometryConfiguration)  # drawn, and told


@dataclass(frozen=True)
class Recording:
    """A drive as it was rendered and measured; K keyframes, N objects."""

    scene: int
    keyframes: tuple[Keyframe, ...]  # K
    labels: tuple[tuple[str, ...], ...]  # K x (D,) true object of each detection
    truth: Array  # (K, 3) true planar poses in map
    object_ids: tuple[str, ...]  # N
    classes: tuple[str, ...]  # N
    objects: Array  # (N, 3) true planar poses in map

    @property
    def detections_per_frame(self) -> float:
        return float(np.mean([len(own) for own in self.labels]))


def record_scene(
    number: int, max_keyframes: int | None = None, objects: Sequence[PlacedObject] | None = None
) -> Recording:
    """Render the room of that number, or with other ``objects``, drive through it and measure what the camera sees."""
    from semantic_slam.datasets.avd.avd_import import import_avd
    from semantic_slam.datasets.avd.drive import ImportSettings
    from semantic_slam.evaluation.belief_bag import read_record
    from semantic_slam.inference.world.map_prior import MapPrior
    from semantic_slam.pipeline.offline import run_bag
    from semantic_slam_lab.simulation.scene import SceneSettings, make_scene

    measuring = Configuration(association="given", semantic_model=SemanticModelConfiguration(kind="none"))
    with TemporaryDirectory() as folder:
        scene = make_scene(Path(folder), number, SceneSettings(tour_only=True), objects)
        bag = Path(folder) / "bag"
        import_avd(scene, bag, None, max_keyframes, number, ImportSettings(image_width=IMAGE_WIDTH))
        summary = run_bag(bag, Path(folder) / "measured", measuring, map_prior=MapPrior())
        return recording_of(read_record(summary.belief_bag), number)


def recording_of(record: Record, scene: int) -> Recording:
    """Every measured frame becomes a keyframe, with detections or without."""
    truth = record.truth
    assert truth is not None and truth.objects is not None
    stamps = sorted(record.measurements)
    points = _odometry_at(record, stamps)
    noise = OdometryConfiguration()
    keyframes = []
    for index, stamp in enumerate(stamps):
        before, now = points[max(index - 1, 0)], points[index]
        measured = record.measurements[stamp]
        odometry, covariance = between(before.pose, now.pose), motion_covariance(before, now, noise)
        keyframes.append(
            Keyframe(
                index=index,
                stamp_ns=stamp,
                odometry=odometry,
                odometry_covariance=covariance,
                measurements=measured,
            )
        )
    labels = [
        tuple(truth.associations[stamp][row] for row in record.measurements[stamp].detection_ids) for stamp in stamps
    ]
    poses = interpolate(truth.trajectory, np.array(stamps, dtype=np.int64))
    return Recording(
        scene,
        tuple(keyframes),
        tuple(labels),
        np.array([planar_from_pose_vector(pose) for pose in poses]),
        truth.objects.object_ids,
        truth.objects.class_names,
        np.array([planar_from_pose_vector(pose) for pose in truth.objects.poses]),
    )


def _odometry_at(record: Record, stamps: list[int]) -> list[OdometryPoint]:
    """Odometry at the frames, whose stamps the odometry has, too."""
    found: dict[int, OdometryPoint] = {}
    point: OdometryPoint | None = None
    for stamp, pose in zip(record.odometry.stamps_ns.tolist(), record.odometry.poses, strict=True):
        sample = OdometrySample(stamp, pose)
        point = start(sample) if point is None else point.advance(sample)
        found[stamp] = point
    return [found[stamp] for stamp in stamps]


def alarms_per_frame(recording: Recording, rates: Rates) -> float:
    """Expected false alarms of a frame that make the stated share of all detections false."""
    true = (1.0 - rates.misses) * recording.detections_per_frame
    return true * rates.clutter / (1.0 - rates.clutter)


def disturbed(recording: Recording, rates: Rates, generator: np.random.Generator) -> Recording:
    """The drive with odometry of its own, detections missed and false ones among the others, from left to right.

    A false alarm lies anywhere in front of the camera and looks like some object: the network's answer is that to a
    detection drawn from the whole drive.
    """
    donors = [keyframe.measurements for keyframe in recording.keyframes if len(keyframe.measurements)]
    expected = alarms_per_frame(recording, rates)
    keyframes, labels = [], []
    motions = _motions(recording, rates.odometry, generator)
    for keyframe, own, motion in zip(recording.keyframes, recording.labels, motions, strict=True):
        kept = np.flatnonzero(generator.random(len(own)) >= rates.misses)
        parts = [keyframe.measurements.take(kept)]
        parts += [_alarm(keyframe.measurements, donors, generator) for _ in range(generator.poisson(expected))]
        joined = _joined(parts)
        names = [own[row] for row in kept] + [CLUTTER] * (len(parts) - 1)
        order = np.argsort(-joined.bearings_rad, kind="stable")  # from left to right
        ordered = replace(joined.take(order), detection_ids=np.arange(len(order), dtype=np.uint32))
        keyframes.append(replace(keyframe, **motion, measurements=ordered))
        labels.append(tuple(names[row] for row in order))
    return replace(recording, keyframes=tuple(keyframes), labels=tuple(labels))


def _motions(
    recording: Recording, noise: OdometryConfiguration, generator: np.random.Generator
) -> list[dict[str, Any]]:
    """Odometry of each keyframe: the true motion since the one before, with an error of the stated covariance.

    The first keyframe is where the robot starts: it has not moved, and knows it.
    """
    found = [{"odometry": pose_vector_from_planar(np.zeros(3)), "odometry_covariance": NO_MOTION}]
    point = start(OdometrySample(0, pose_vector_from_planar(recording.truth[0])))
    for index, pose in enumerate(recording.truth[1:], start=1):
        before, point = point, point.advance(OdometrySample(index, pose_vector_from_planar(pose)))
        covariance = motion_covariance(before, point, noise)
        error = np.sqrt(np.diag(planar_from_covariance(covariance))) * generator.standard_normal(3)
        moved = se2.compose(se2.between(recording.truth[index - 1], pose), se2.exp(error))
        found.append({"odometry": pose_vector_from_planar(moved), "odometry_covariance": covariance})
    return found


def _joined(parts: list[SemanticMeasurements]) -> SemanticMeasurements:
    """The detections of several frames as those of the first, without identities."""
    joined = joined_rows(parts, whole=OF_THE_FRAME)
    return replace(joined, track_ids=("",) * len(joined))


def _alarm(
    frame: SemanticMeasurements, donors: list[SemanticMeasurements], generator: np.random.Generator
) -> SemanticMeasurements:
    """One false detection."""
    donor = donors[generator.integers(len(donors))]
    copied = donor.take(np.array([generator.integers(len(donor))]))
    near, far = ALARM_RANGE_M
    reach = np.sqrt(generator.uniform(near**2, far**2, 1))
    bearing = ALARM_FIELD_OF_VIEW_RAD * generator.uniform(-0.5, 0.5, 1)
    return replace(copied, stamp_ns=frame.stamp_ns, sequence=frame.sequence, ranges_m=reach, bearings_rad=bearing)
