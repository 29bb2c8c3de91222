"""The hybrid belief as a message."""

from typing import Any

from semantic_slam.inference.belief import HybridBelief
from semantic_slam.messages.layout import Layout, pack, unpack
from semantic_slam.messages.standard import header_message, header_stamp_ns
from semantic_slam.messages.typestore import message_class

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
    "existence": ("O",),
    "class_probabilities": ("O", "C"),
    "object_poses": ("O", 7),
    "object_covariances": ("O", 6, 6),
    "mutual_information": ("O",),
    "in_coverage": ("O",),
    "forgotten_views": ("O",),
    "descriptors": ("O", "L"),
    "descriptor_covariances": ("O", "L"),
}


def belief_to_message(value: HybridBelief) -> Any:
    return message_class(BELIEF_TYPE)(
        header=header_message(value.stamp_ns, "map"),
        keyframe=int(value.keyframe),
        planar=bool(value.planar),
        num_candidates=int(value.num_candidates),
        association_entropy=float(value.association_entropy),
        component_entropy=float(value.component_entropy),
        discarded_mass=float(value.discarded_mass),
        dropped=int(value.dropped),
        num_merged=int(value.num_merged),
        reproducible=bool(value.reproducible),
        **pack(BELIEF_TYPE, BELIEF_LAYOUT, vars(value)),
    )


def belief_from_message(message: Any) -> HybridBelief:
    return HybridBelief(
        stamp_ns=header_stamp_ns(message),
        keyframe=int(message.keyframe),
        planar=bool(message.planar),
        num_candidates=int(message.num_candidates),
        association_entropy=float(message.association_entropy),
        component_entropy=float(message.component_entropy),
        discarded_mass=float(message.discarded_mass),
        dropped=int(message.dropped),
        num_merged=int(message.num_merged),
        reproducible=bool(message.reproducible),
        **unpack(BELIEF_TYPE, BELIEF_LAYOUT, message),
    )
