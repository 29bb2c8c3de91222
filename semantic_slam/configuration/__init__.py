"""Every parameter, with its default, exactly once.

ROS parameters, YAML files and the saved effective configuration all derive from these dataclasses: a nested
field ``pruning.ratio`` is the ROS parameter ``pruning.ratio`` and the YAML key ``ratio`` under ``pruning``. It
stands in ``pruning.py``: every section has a file of its name.
"""

from semantic_slam.configuration.checked_value import choices_of
from semantic_slam.configuration.closed_world import ClosedWorldConfiguration
from semantic_slam.configuration.configuration import Configuration
from semantic_slam.configuration.detection_errors import DetectionErrorsConfiguration
from semantic_slam.configuration.dictionary import from_dict, to_dict
from semantic_slam.configuration.history import HistoryConfiguration
from semantic_slam.configuration.imu import ImuConfiguration
from semantic_slam.configuration.initial_pose import InitialPoseConfiguration
from semantic_slam.configuration.keyframes import KeyframeConfiguration
from semantic_slam.configuration.moving import MovingConfiguration
from semantic_slam.configuration.new_objects import NewObjectConfiguration
from semantic_slam.configuration.odometry import OdometryConfiguration
from semantic_slam.configuration.open_world import OpenWorldConfiguration
from semantic_slam.configuration.perception import PerceptionConfiguration
from semantic_slam.configuration.pruning import PruningConfiguration
from semantic_slam.configuration.revision import RevisionConfiguration
from semantic_slam.configuration.semantic_model import SemanticModelConfiguration
from semantic_slam.configuration.visibility import VisibilityConfiguration
from semantic_slam.configuration.weights import WeightsConfiguration
from semantic_slam.configuration.yaml_file import load_configuration

__all__ = [
    "ClosedWorldConfiguration",
    "Configuration",
    "DetectionErrorsConfiguration",
    "HistoryConfiguration",
    "ImuConfiguration",
    "InitialPoseConfiguration",
    "KeyframeConfiguration",
    "MovingConfiguration",
    "NewObjectConfiguration",
    "OdometryConfiguration",
    "OpenWorldConfiguration",
    "PerceptionConfiguration",
    "PruningConfiguration",
    "RevisionConfiguration",
    "SemanticModelConfiguration",
    "VisibilityConfiguration",
    "WeightsConfiguration",
    "choices_of",
    "from_dict",
    "load_configuration",
    "to_dict",
]
