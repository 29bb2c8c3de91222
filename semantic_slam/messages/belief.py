"""The hybrid belief as a message."""

from typing import Any

from semantic_slam.inference.belief import HybridBelief
from semantic_slam.messages.layout import Layout, MayBeEmpty, contents, filled
from semantic_slam.messages.objects import object_layout
from semantic_slam.messages.standard import header_message, header_stamp_ns

BELIEF_TYPE = "semantic_slam_msgs/msg/HybridBelief"

BELIEF_LAYOUT: Layout = {
    "class_names": ("C",),
    "hypothesis_ids": ("H",),
    "parent_ids": ("H",),
    "modes": ("H",),
    "log_weights": ("H",),
    "poses": ("H", 7),
    "pose_covariances": ("H", 6, 6),
    "detection_ids": ("D",),
    "associations": ("H", "D"),
    "object_ids": ("O",),
    "object_names": ("O",),
    "hypothesis_class_probabilities": ("H", "O", "C"),
    **object_layout("O"),
    "association_probabilities": MayBeEmpty(("D", "O+1")),
    "outlier_probability": MayBeEmpty(("D",)),
    "noise_names": ("N",),
    "noise_values": ("N",),
    "noise_sigmas": ("N",),
    "revised_ids": ("R",),
    "revised_keyframes": ("R",),
    "revised_detections": ("R",),
    "revised_objects": ("R",),
    "place_objects": ("M",),
    "place_probabilities": ("M",),
    "place_means": ("M", 3),
    "place_covariances": ("M", 3, 3),
}


def belief_to_message(value: HybridBelief, frame_id: str = "map") -> Any:
    return filled(BELIEF_TYPE, BELIEF_LAYOUT, vars(value), header=header_message(value.stamp_ns, frame_id))


def belief_from_message(message: Any) -> HybridBelief:
    values = contents(BELIEF_TYPE, BELIEF_LAYOUT, message)
    values["state_space"] = values["state_space"] or "planar"  # before beliefs told theirs, all were
    return HybridBelief(stamp_ns=header_stamp_ns(message), **values)
