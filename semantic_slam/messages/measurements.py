"""Detections and semantic measurements as messages."""

from typing import Any

from semantic_slam.messages.layout import Layout, pack, unpack
from semantic_slam.messages.standard import header_message, header_stamp_ns
from semantic_slam.messages.typestore import message_class
from semantic_slam.perception.frame import Detections
from semantic_slam.perception.measurement import SemanticMeasurements

DETECTIONS_TYPE = "semantic_slam_msgs/msg/DetectionArray"
MEASUREMENTS_TYPE = "semantic_slam_msgs/msg/SemanticMeasurementArray"

DETECTIONS_LAYOUT: Layout = {"labels": ("D",), "boxes": ("D", 4), "scores": ("D",), "track_ids": ("D",)}

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
}


def detections_to_message(value: Detections) -> Any:
    header = header_message(value.stamp_ns, value.frame_id)
    return message_class(DETECTIONS_TYPE)(header=header, **pack(DETECTIONS_TYPE, DETECTIONS_LAYOUT, vars(value)))


def detections_from_message(message: Any) -> Detections:
    return Detections(
        stamp_ns=header_stamp_ns(message),
        frame_id=message.header.frame_id,
        **unpack(DETECTIONS_TYPE, DETECTIONS_LAYOUT, message),
    )


def measurements_to_message(value: SemanticMeasurements) -> Any:
    values = {**vars(value), "ranges": value.ranges_m, "bearings": value.bearings_rad}
    values |= {"elevations": value.elevations_rad, "sight": value.free_range_scan}
    return message_class(MEASUREMENTS_TYPE)(
        header=header_message(value.stamp_ns, value.frame_id),
        sequence=int(value.sequence),
        num_passes=int(value.class_probability_samples.shape[1]),
        num_features=int(value.features.shape[1]),
        dropped=int(value.dropped),
        **pack(MEASUREMENTS_TYPE, MEASUREMENTS_LAYOUT, values),
    )


def measurements_from_message(message: Any) -> SemanticMeasurements:
    sizes = {"T": int(message.num_passes), "F": int(message.num_features)}
    arrays = unpack(MEASUREMENTS_TYPE, MEASUREMENTS_LAYOUT, message, sizes)
    return SemanticMeasurements(
        stamp_ns=header_stamp_ns(message),
        sequence=int(message.sequence),
        frame_id=message.header.frame_id,
        ranges_m=arrays.pop("ranges"),
        bearings_rad=arrays.pop("bearings"),
        elevations_rad=arrays.pop("elevations"),
        free_range_scan=arrays.pop("sight"),
        dropped=int(message.dropped),
        **arrays,
    )
