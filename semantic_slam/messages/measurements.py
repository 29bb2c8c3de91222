"""Detections and semantic measurements as messages."""

from typing import Any

from semantic_slam.messages.layout import Layout, MayBeEmpty, contents, filled
from semantic_slam.messages.standard import header_message, header_stamp_ns
from semantic_slam.perception.frame import Detections
from semantic_slam.perception.image_sight import GRID
from semantic_slam.perception.measurement import SemanticMeasurements

DETECTIONS_TYPE = "semantic_slam_msgs/msg/DetectionArray"
MEASUREMENTS_TYPE = "semantic_slam_msgs/msg/SemanticMeasurementArray"

DETECTIONS_LAYOUT: Layout = {
    "labels": ("D",),
    "boxes": ("D", 4),
    "scores": ("D",),
    "track_ids": ("D",),
    "class_names": ("C",),
    "class_scores": MayBeEmpty(("D", "C")),
    "embeddings": MayBeEmpty(("D", "E")),
    "positions": MayBeEmpty(("D", 3)),
    "position_covariances": MayBeEmpty(("D", 3, 3)),
    "ranges_m": MayBeEmpty(("D",)),
    "bearings_rad": MayBeEmpty(("D",)),
    "elevations_rad": MayBeEmpty(("D",)),
    "place_covariances": MayBeEmpty(("D", 3, 3)),
}

MEASUREMENTS_LAYOUT: Layout = {
    "class_names": ("C",),
    "detection_ids": ("D",),
    "boxes": ("D", 4),
    "labels": ("D",),
    "scores": ("D",),
    "track_ids": ("D",),
    "class_probability_samples": ("D", "T", "C"),
    "features": ("D", "F"),
    "feature_covariances": ("D", "F", "F"),
    "predictive_entropy": ("D",),
    "mutual_information": ("D",),
    "ranges": ("D",),
    "bearings": ("D",),
    "geometric_covariances": ("D", 2, 2),
    "sensor_position": (3,),
    "in_coverage": ("D",),
    "sight": ("B", 2),
    "elevations": ("D",),
    "place_covariances": MayBeEmpty(("D", 3, 3)),
    "class_scores": MayBeEmpty(("D", "C")),
    "embeddings": MayBeEmpty(("D", "E")),
    "points": MayBeEmpty(("D", 3)),
    "point_covariances": MayBeEmpty(("D", 3, 3)),
    "sensor_orientation": MayBeEmpty((4,)),
    "angular_sizes_rad": MayBeEmpty(("D", 2)),
    "image_edges_rad": MayBeEmpty((2, 2)),
    "free_ranges_m": MayBeEmpty(GRID),
}
FIELD_NAMES = {
    "ranges": "ranges_m",
    "bearings": "bearings_rad",
    "elevations": "elevations_rad",
    "sight": "free_range_scan",
}
"""Renamed fields: our name for each field that has another name in recorded bags."""


def detections_to_message(value: Detections) -> Any:
    header = header_message(value.stamp_ns, value.frame_id)
    return filled(DETECTIONS_TYPE, DETECTIONS_LAYOUT, vars(value), header=header)


def detections_from_message(message: Any) -> Detections:
    return Detections(
        stamp_ns=header_stamp_ns(message),
        frame_id=message.header.frame_id,
        **contents(DETECTIONS_TYPE, DETECTIONS_LAYOUT, message),
    )


def measurements_to_message(value: SemanticMeasurements) -> Any:
    values = vars(value) | {name: getattr(value, ours) for name, ours in FIELD_NAMES.items()}
    values |= {"num_passes": value.class_probability_samples.shape[1], "num_features": value.features.shape[1]}
    return filled(MEASUREMENTS_TYPE, MEASUREMENTS_LAYOUT, values, header=header_message(value.stamp_ns, value.frame_id))


def measurements_from_message(message: Any) -> SemanticMeasurements:
    sizes = {"T": int(message.num_passes), "F": int(message.num_features)}
    values = contents(MEASUREMENTS_TYPE, MEASUREMENTS_LAYOUT, message, sizes)
    values |= {ours: values.pop(name) for name, ours in FIELD_NAMES.items()}
    del values["num_passes"], values["num_features"]
    return SemanticMeasurements(stamp_ns=header_stamp_ns(message), frame_id=message.header.frame_id, **values)
