"""Topic names and their types, in one place."""

DETECTIONS = "detections"
IMAGE = "image"
IMAGE_COMPRESSED = "image/compressed"
DEPTH = "depth"
DEPTH_COMPRESSED = "depth/compressed"
DISPARITY = "disparity"
CAMERA_INFO = "camera_info"
ODOMETRY = "odom"
IMU = "imu"
INITIAL_POSE = "initialpose"
TF = "/tf"
TF_STATIC = "/tf_static"
CLOCK = "/clock"
DIAGNOSTICS = "/diagnostics"

MEASUREMENTS = "/classifier/measurements"
CLASSIFIER_PROGRESS = "/classifier/progress"
BELIEF = "/hypothesis_manager/belief"
POSE = "/hypothesis_manager/pose"
PATH = "/hypothesis_manager/path"
MARKERS = "/hypothesis_manager/markers"
OBJECTS_3D = "/hypothesis_manager/objects"
LABEL_INFO = "/hypothesis_manager/label_info"
RUN_CONFIGURATION = "/hypothesis_manager/run_configuration"
KEYFRAMES = "/hypothesis_manager/keyframes"
COMMITS = "/hypothesis_manager/commits"
CANDIDATES = "/hypothesis_manager/candidates"
COMPONENTS = "/hypothesis_manager/components"
MISSED = "/hypothesis_manager/missed_keyframes"
PLAYER_PROGRESS = "/bag_player/progress"
MANAGER_PROGRESS = "/hypothesis_manager/progress"

GROUND_TRUTH_ODOMETRY = "/ground_truth/odom"
GROUND_TRUTH_OBJECTS = "/ground_truth/objects"
GROUND_TRUTH_ASSOCIATIONS = "/ground_truth/associations"

TYPES = {
    DETECTIONS: "semantic_slam_msgs/msg/DetectionArray",
    IMAGE: "sensor_msgs/msg/Image",
    IMAGE_COMPRESSED: "sensor_msgs/msg/CompressedImage",
    DEPTH: "sensor_msgs/msg/Image",
    DEPTH_COMPRESSED: "sensor_msgs/msg/CompressedImage",
    DISPARITY: "stereo_msgs/msg/DisparityImage",
    CAMERA_INFO: "sensor_msgs/msg/CameraInfo",
    ODOMETRY: "nav_msgs/msg/Odometry",
    IMU: "sensor_msgs/msg/Imu",
    INITIAL_POSE: "geometry_msgs/msg/PoseWithCovarianceStamped",
    TF: "tf2_msgs/msg/TFMessage",
    TF_STATIC: "tf2_msgs/msg/TFMessage",
    CLOCK: "rosgraph_msgs/msg/Clock",
    DIAGNOSTICS: "diagnostic_msgs/msg/DiagnosticArray",
    MEASUREMENTS: "semantic_slam_msgs/msg/SemanticMeasurementArray",
    BELIEF: "semantic_slam_msgs/msg/HybridBelief",
    POSE: "geometry_msgs/msg/PoseWithCovarianceStamped",
    PATH: "nav_msgs/msg/Path",
    MARKERS: "visualization_msgs/msg/MarkerArray",
    RUN_CONFIGURATION: "semantic_slam_msgs/msg/RunConfiguration",
    KEYFRAMES: "semantic_slam_msgs/msg/Keyframe",
    COMMITS: "semantic_slam_msgs/msg/Commit",
    CANDIDATES: "semantic_slam_msgs/msg/Candidates",
    COMPONENTS: "semantic_slam_msgs/msg/Components",
    MISSED: "semantic_slam_msgs/msg/MissedKeyframes",
    PLAYER_PROGRESS: "semantic_slam_msgs/msg/ReplayProgress",
    CLASSIFIER_PROGRESS: "semantic_slam_msgs/msg/ReplayProgress",
    MANAGER_PROGRESS: "semantic_slam_msgs/msg/ReplayProgress",
    GROUND_TRUTH_ODOMETRY: "nav_msgs/msg/Odometry",
    GROUND_TRUTH_OBJECTS: "semantic_slam_msgs/msg/GroundTruthObjects",
    GROUND_TRUTH_ASSOCIATIONS: "semantic_slam_msgs/msg/GroundTruthAssociations",
}
VISION_TYPES = {OBJECTS_3D: "vision_msgs/msg/Detection3DArray", LABEL_INFO: "vision_msgs/msg/LabelInfo"}
"""Types of topics published only where package vision_msgs is installed; nothing here subscribes to them."""
GLOBAL = frozenset({TF, TF_STATIC, CLOCK, DIAGNOSTICS})
"""Global topics: their names do not depend on the namespace, unless they are remapped."""
LATCHED = frozenset({TF_STATIC, RUN_CONFIGURATION, GROUND_TRUTH_OBJECTS, INITIAL_POSE})
"""Latched topics (TRANSIENT_LOCAL): a late subscriber still receives the last message."""
KEPT_INPUTS = (
    ODOMETRY,
    IMU,
    INITIAL_POSE,
    TF_STATIC,
    GROUND_TRUTH_ODOMETRY,
    GROUND_TRUTH_OBJECTS,
    GROUND_TRUTH_ASSOCIATIONS,
)
"""Inputs copied to the belief bag, needed by reports to evaluate the belief."""
