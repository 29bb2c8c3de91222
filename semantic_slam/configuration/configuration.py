"""The whole configuration of a run: what belongs to no section, and every section under the name of its file."""

from dataclasses import dataclass, field
from typing import Any

from semantic_slam.configuration.closed_world import ClosedWorldConfiguration
from semantic_slam.configuration.detection_errors import DetectionErrorsConfiguration
from semantic_slam.configuration.history import HistoryConfiguration
from semantic_slam.configuration.imu import ImuConfiguration
from semantic_slam.configuration.initial_pose import InitialPoseConfiguration
from semantic_slam.configuration.keyframes import KeyframeConfiguration
from semantic_slam.configuration.moving import MovingConfiguration
from semantic_slam.configuration.new_objects import NewObjectConfiguration
from semantic_slam.configuration.odometry import OdometryConfiguration
from semantic_slam.configuration.open_world import OpenWorldConfiguration
from semantic_slam.configuration.parameter import parameter
from semantic_slam.configuration.perception import PerceptionConfiguration
from semantic_slam.configuration.pruning import PruningConfiguration
from semantic_slam.configuration.revision import RevisionConfiguration
from semantic_slam.configuration.sections import build_section
from semantic_slam.configuration.semantic_model import SemanticModelConfiguration
from semantic_slam.configuration.visibility import VisibilityConfiguration
from semantic_slam.configuration.weights import WeightsConfiguration
from semantic_slam.registry import ASSOCIATIONS, OBSERVATIONS

PLANAR, SPATIAL = STATE_SPACES = ("planar", "spatial")
"""Values of ``state_space``."""


@dataclass(frozen=True)
class Configuration:
    """The effective configuration of a run. Distances in metres, angles in radians."""

    seed: int = parameter(0, "seed of every random draw", minimum=0, maximum=2**63 - 1)
    association: str = parameter(
        "enumerated",
        "data association: enumerated over a known map, given with the detections' ids, or open: objects come and go",
        choices=ASSOCIATIONS,
    )
    observation: str = parameter(
        "range_bearing",
        "what a detection measures: range_bearing of objects with a heading, or of points, which have none",
        choices=OBSERVATIONS,
    )
    state_space: str = parameter(
        "planar",
        "where the robot and its objects are: planar, or spatial with all six of the pose, with observation: points and"
        " semantic_model.kind: none, detector, embedding or detector_embedding, or observation: range_bearing and class"
        " scores by viewpoint",
        choices=STATE_SPACES,
    )
    distinct_assignment: bool = parameter(True, "one object takes at most one detection of a frame")
    semantic_model: SemanticModelConfiguration = field(default_factory=SemanticModelConfiguration)
    weights: WeightsConfiguration = field(default_factory=WeightsConfiguration)
    pruning: PruningConfiguration = field(default_factory=PruningConfiguration)
    visibility: VisibilityConfiguration = field(default_factory=VisibilityConfiguration)
    open_world: OpenWorldConfiguration = field(default_factory=OpenWorldConfiguration)
    detection_errors: DetectionErrorsConfiguration = field(default_factory=DetectionErrorsConfiguration)
    revision: RevisionConfiguration = field(default_factory=RevisionConfiguration)
    history: HistoryConfiguration = field(default_factory=HistoryConfiguration)
    moving: MovingConfiguration = field(default_factory=MovingConfiguration)
    closed_world: ClosedWorldConfiguration = field(default_factory=ClosedWorldConfiguration)
    initial_pose: InitialPoseConfiguration = field(default_factory=InitialPoseConfiguration)
    new_objects: NewObjectConfiguration = field(default_factory=NewObjectConfiguration)
    odometry: OdometryConfiguration = field(default_factory=OdometryConfiguration)
    imu: ImuConfiguration = field(default_factory=ImuConfiguration)
    keyframes: KeyframeConfiguration = field(default_factory=KeyframeConfiguration)
    perception: PerceptionConfiguration = field(default_factory=PerceptionConfiguration)

    @property
    def is_spatial(self) -> bool:
        """Whether all six of a pose are estimated."""
        return self.state_space == SPATIAL

    @classmethod
    def of(cls, **values: Any) -> "Configuration":
        """Checked, from values as a YAML file has them: ``Configuration.of(semantic_model={"kind": "none"})``.

        What is left out keeps its default. Raises InputError.
        """
        made: Configuration = build_section(cls, values, "configuration")
        return made
