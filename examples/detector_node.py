"""Detects objects in pictures with the ONNX file of a NanoDet or YOLO network, run by OpenCV:

python examples/detector_node.py yolo11n.onnx coco.names --ros-args -r image/compressed:=/camera/image/compressed

With -p compressed:=false it takes the topic image instead. Where the file leaves its input size open -p input_size:=640
states it, and where its output fits several layouts -p layout:=yolov5 does.
"""

import argparse
import sys
from pathlib import Path

import rclpy
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.utilities import remove_ros_args
from semantic_slam_msgs.msg import DetectionArray
from sensor_msgs.msg import CompressedImage, Image

from semantic_slam.errors import InputError
from semantic_slam.messages.images import decode_image
from semantic_slam.perception.onnx.detector import DetectorSettings, OnnxDetector, read_class_names


def detection_array(detector, image):
    """The DetectionArray of what a detector sees in an Image or CompressedImage.

    For a detector of yours fill the same fields: boxes and labels, and if it tells them the classes that it knows with
    the scores of all. A picture of nothing is a message, too: it says what is not there. Types are what the fields
    want, float() and list(): rclpy checks none of them. Raises InputError for a picture that does not decode, and for
    one in which the network reports a class without a name.
    """
    found = detector(decode_image(image, "image"), stamp_ns=0, frame_id=image.header.frame_id)
    message = DetectionArray(header=image.header)  # stamp and frame of the picture
    message.boxes = found.boxes.ravel().tolist()  # D x 4: x_min, y_min, x_max, y_max in pixels
    message.labels, message.scores = list(found.labels), found.scores.tolist()
    message.track_ids = [""] * len(found)
    message.class_names = list(found.class_names)  # C, in the order of the scores
    message.class_scores = found.class_scores.ravel().tolist()  # D x C
    return message


class DetectorNode(Node):
    def __init__(self, network, names):
        super().__init__("detector")
        size, layout = self.declare_parameter("input_size", 0).value, self.declare_parameter("layout", "").value
        settings = DetectorSettings(input_size=size or None, layout=layout or None)
        self._detector = OnnxDetector(network, read_class_names(names), settings)
        self._publisher = self.create_publisher(DetectionArray, "detections", 10)
        is_compressed = self.declare_parameter("compressed", True).value
        kind, topic = (CompressedImage, "image/compressed") if is_compressed else (Image, "image")
        self.create_subscription(kind, topic, self._detect, qos_profile_sensor_data)

    def _detect(self, image):
        try:
            self._publisher.publish(detection_array(self._detector, image))
        except InputError as fault:
            self.get_logger().warning(str(fault), throttle_duration_sec=10.0)


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("network", type=Path, metavar="NETWORK.onnx")
    arguments.add_argument("names", type=Path, metavar="CLASSES.names", help="one class name a line")
    given = arguments.parse_args(remove_ros_args(sys.argv)[1:])
    rclpy.init(args=sys.argv)
    try:
        node = DetectorNode(given.network, given.names)
        while rclpy.ok():
            rclpy.spin_once(node, timeout_sec=1.0)  # spin() may wait for ever: a signal just before it waits is missed
    except KeyboardInterrupt:
        pass
    except Exception:
        if rclpy.ok():  # after a signal, whatever rclpy still does fails
            raise
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
