"""Viewing directions of an object along one history, and the reliability of each view."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from semantic_slam.answers.explain.ledger import ClassLedger
from semantic_slam.answers.explain.outlier_views import OutlierViews
from semantic_slam.answers.explain.replayed_run import ReplayedRun
from semantic_slam.evaluation.seen_from import seen_from
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import planar_from_pose_vector, wrap_angle
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.perception.measurement import SemanticMeasurements

KNOWN_HEADING_RAD = 0.5
"""Largest standard deviation [rad] of an object's heading at which directions are relative to its front."""


@dataclass(frozen=True, kw_only=True)
class Sighting:
    """One detection associated with the object by the history."""

    keyframe: int
    stamp_ns: int
    detection: int  # index within the keyframe
    direction_rad: float  # from the object to the camera, counter-clockwise about the vertical
    from_front: bool  # direction relative to the object's front, not to the map's x axis
    range_m: float  # between object and camera; in space with their heights
    mutual_information: float  # nats, between class and network weights; NaN: not sampled by the models
    in_coverage: bool  # the class models know such images
    no_object: float  # probability that it is of no known object; NaN in an open world
    outlier: float  # outlier probability; NaN where views cannot be outliers

    @property
    def degrees(self) -> str:
        """Direction in whole degrees, 0 to 359, as text."""
        return str(round(float(np.rad2deg(self.direction_rad))) % 360)


def sightings(
    run: ReplayedRun,
    ledger: ClassLedger,
    measurements: Mapping[int, SemanticMeasurements],
    outliers: OutlierViews | None,
) -> tuple[Sighting, ...]:
    """All views of the object of a ledger, along its history."""
    last = run.keyframes[-1].belief
    row = last.object_ids.tolist().index(ledger.object_id)
    place, from_front = last.object_poses[row], _has_front(last, row)
    heading = float(planar_from_pose_vector(place)[2]) if from_front else 0.0
    found = []
    for k in np.flatnonzero(ledger.is_view).tolist():
        belief, own = run.keyframes[k].belief, ledger.steps[k]
        assert own is not None  # the object has views
        association = [run.on_map(n) for n in own.association]
        measured = measurements.get(belief.stamp_ns)
        sensor = measured.sensor_position if measured is not None else np.zeros(3)
        azimuth, _, distance = seen_from(own.pose, place[:3], sensor, in_space=not last.planar)
        direction = float(wrap_angle(np.array(azimuth - heading))) if from_front else azimuth
        for detection in (d for d, n in enumerate(association) if n == ledger.object_id):
            found.append(
                Sighting(
                    keyframe=belief.keyframe,
                    stamp_ns=belief.stamp_ns,
                    detection=detection,
                    direction_rad=direction,
                    from_front=from_front,
                    range_m=distance,
                    mutual_information=_of_object(belief, belief.mutual_information, ledger.object_id),
                    in_coverage=measured is None or _in_coverage(measured, int(belief.detection_ids[detection])),
                    no_object=float(belief.outlier_probability[detection]),
                    outlier=_outlier(outliers, measured, int(belief.detection_ids[detection]), ledger, k),
                )
            )
    return tuple(found)


def _has_front(belief: HybridBelief, row: int) -> bool:
    """Whether the heading of an object is known; points of space have none, and state a variance of 0."""
    variance = float(belief.object_covariances[row, 5, 5])
    is_point = variance == 0.0 and not belief.planar
    return not is_point and bool(np.sqrt(variance) < KNOWN_HEADING_RAD)


def _of_object(belief: HybridBelief, values: Array, object_id: int) -> float:
    rows = np.flatnonzero(belief.object_ids == object_id)
    return float(values[rows[0]]) if len(rows) else float("nan")


def _in_coverage(measured: SemanticMeasurements, detection_id: int) -> bool:
    rows = np.flatnonzero(measured.detection_ids == detection_id)
    return not len(rows) or bool(measured.in_coverage[rows[0]])


def _outlier(
    outliers: OutlierViews | None, measured: SemanticMeasurements | None, detection_id: int, ledger: ClassLedger, k: int
) -> float:
    if outliers is None or measured is None:
        return float("nan")
    return outliers.probability(measured, detection_id, float(ledger.alone[k, int(np.argmax(ledger.log_posterior))]))


def object_name(belief: HybridBelief, object_id: int) -> str:
    """Name of an object in a belief; its number where the belief does not have it."""
    rows = np.flatnonzero(belief.object_ids == object_id)
    return belief.object_names[rows[0]] if len(rows) else str(object_id)
