"""Parameters of the hypothesis manager, described in ``hypothesis_manager_node``, with their values at start."""

from dataclasses import dataclass
from typing import Self

from rclpy.node import Node

from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.pipeline.idle_parameters import idle_parameters
from semantic_slam.pipeline.session import CHANGEABLE
from semantic_slam.ros.node.parameters import (
    declare_changeable,
    declare_configuration,
    declare_fixed,
    refuse_undeclared,
)
from semantic_slam.ros.node.run_inputs import map_prior_of, source_of
from semantic_slam.ros.publishing.frames import Frames, declare_frames


@dataclass(frozen=True, kw_only=True)
class ManagerParameters:
    """Values of all parameters; the files that they name are read."""

    configuration: Configuration
    num_backends: int
    backend_timeout_s: float
    broadcasts_odom: bool
    has_imu: bool
    map_prior: MapPrior | None
    source: str  # provenance of the bag that is replayed, "" for none
    journal: str  # its folder, "" for none
    frames: Frames
    resume: bool

    @classmethod
    def declared(cls, node: Node) -> Self:
        """Declare the parameters of ``node`` and read their values. Raises InputError, also for unknown names."""
        configuration = declare_configuration(node, CHANGEABLE)
        for idle in idle_parameters(configuration):
            node.get_logger().warning(idle.line)
        num_backends = declare_fixed(node, "backends", 1)
        if num_backends < 1:
            raise InputError(f"parameter backends is {num_backends}; at least one backend is needed")
        values = cls(
            configuration=configuration,
            num_backends=num_backends,
            backend_timeout_s=declare_changeable(node, "backend_timeout_s", 60.0),
            broadcasts_odom=declare_changeable(node, "broadcast_odom", False),
            has_imu=declare_fixed(node, "has_imu", False),
            map_prior=map_prior_of(node, configuration, declare_fixed(node, "map_prior", "")),
            source=source_of(declare_fixed(node, "source_bag", "")),
            journal=declare_fixed(node, "journal", ""),
            frames=declare_frames(node),
            resume=declare_fixed(node, "resume", True),
        )
        refuse_undeclared(node)
        return values
