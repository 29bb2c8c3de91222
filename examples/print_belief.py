"""Prints the likeliest class of every object at every keyframe."""

import numpy as np
import rclpy
from semantic_slam_msgs.msg import HybridBelief


def show(belief):
    classes = np.reshape(belief.class_probabilities, (len(belief.object_ids), -1))
    for object_id, name, p in zip(belief.object_ids, belief.object_names, classes, strict=True):
        likeliest = f"{belief.class_names[p.argmax()]} ({p.max():.0%})" if p.size else name
        print(f"{belief.keyframe}: object {object_id}: {likeliest}", flush=True)


rclpy.init()
node = rclpy.create_node("print_belief")
node.create_subscription(HybridBelief, "/hypothesis_manager/belief", show, 10)
rclpy.spin(node)
