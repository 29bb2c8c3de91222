"""What a hypothesis manager's parameters name: a map, the bag that is replayed, an IMU."""

from pathlib import Path

from rclpy.node import Node

from semantic_slam.bag.reader import BagReader
from semantic_slam.configuration import Configuration
from semantic_slam.inference.association.strategy import strategy_of
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.maps.map_file import read_map_prior
from semantic_slam.messages import topics
from semantic_slam.messages.sensor import TransformTree
from semantic_slam.pipeline.gravity.gravity_by_imu import ImuSource
from semantic_slam.pipeline.gravity.imu_use import unused_because
from semantic_slam.pipeline.provenance import source_text


def imu_source(node: Node, configuration: Configuration, transforms: TransformTree, *, waits: bool) -> ImuSource | None:
    """Source of IMU readings; None, with a warning, if the configuration does not use topic imu."""
    reason = unused_because(configuration)
    if reason:
        node.get_logger().warning(f"parameter has_imu: topic {topics.IMU} is not used: {reason}")
        return None
    return ImuSource(transforms, waits=waits)


def map_prior_of(node: Node, configuration: Configuration, path: str) -> MapPrior | None:
    """The map in a file; "" names none. Warns where a run needs a map with objects. Raises InputError."""
    prior = read_map_prior(Path(path)) if path else None
    if strategy_of(configuration).needs_map and not (prior and prior.objects):
        node.get_logger().warning(
            f"association is '{configuration.association}' and parameter map_prior names no map with objects: unless"
            " ~/load_map gives one before, the first keyframe ends this node; set map_prior, or set association: open"
            " to map as you go"
        )
    return prior


def source_of(bag: str) -> str:
    """Provenance of a bag; "" names none. Raises InputError."""
    return source_text(Path(bag), BagReader(Path(bag)).sha256()) if bag else ""
