"""Prints the likeliest class of every object, and how ambiguous it is, at every keyframe."""

import numpy as np
import rclpy
from semantic_slam_msgs.msg import HybridBelief


def show(belief):
    names = belief.class_names or ["object"]
    classes = np.reshape(belief.class_probabilities or np.ones(len(belief.object_ids)), (-1, len(names)))
    for object_id, p in zip(belief.object_ids, classes, strict=True):
        ambiguity = -np.sum(p * np.log(np.maximum(p, 1e-300)))  # entropy in nats: 0 is certain
        print(f"{belief.keyframe}: object {object_id}: {names[np.argmax(p)]}, ambiguity {ambiguity:.2f}", flush=True)


rclpy.init()
node = rclpy.create_node("print_belief")
node.create_subscription(HybridBelief, "/hypothesis_manager/belief", show, 10)
rclpy.spin(node)
