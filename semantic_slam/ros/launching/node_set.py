"""The nodes of a replay, or of a live robot, and their parameters, as started by the launch files and by the demo."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any

from semantic_slam.bag.names import absolute
from semantic_slam.bag.reader import BagReader
from semantic_slam.class_models.kind import class_model_kind
from semantic_slam.configuration import Configuration, load_configuration
from semantic_slam.errors import InputError
from semantic_slam.maps.map_file import read_map_prior
from semantic_slam.messages import topics
from semantic_slam.messages.sensor import plain_frame, sensor_pose
from semantic_slam.outputs import LEAVE_OF_NODES, check_bag_output
from semantic_slam.pipeline.detector_labels import known_labels, labels_in
from semantic_slam.pipeline.gravity.imu_use import unused_because
from semantic_slam.pipeline.input_topics import InputTopics, find_topics
from semantic_slam.pipeline.preamble import map_prior_path, read_preamble
from semantic_slam.ros.node.parameters import changed_parameters

FIRST_TRANSFORMS = 100
LOSSLESS = 0.0
"""Rate that means lock-step: as fast as the nodes can process, without loss."""


@dataclass(frozen=True)
class NodeSpec:
    """Process of one node: an executable of this package, the node's name, and its non-default parameters.

    If it dies, it is restarted with the additional parameters ``again``; None: its death ends the run. ``followers``
    are nodes that are restarted together with it.
    """

    executable: str
    name: str
    parameters: dict[str, Any] = field(default_factory=dict)
    again: dict[str, Any] | None = field(default_factory=dict)
    followers: tuple[str, ...] = ()

    def anew(self) -> "NodeSpec":
        """Specification of the process that replaces one that died."""
        return replace(self, parameters=self.parameters | (self.again or {}))


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """How a run is divided, recorded and restarted.

    ``record``: belief bag to write, "" for none; an existing one is replaced only with ``overwrite``. ``journal``: the
    manager's journal folder, "" for none: then the manager's death ends the run. ``resume``: continue journal and
    belief bag of an interrupted run. ``autostart`` False: the nodes wait for lifecycle transitions. ``map_frame``: of
    beliefs and TF, "" for "map".
    """

    backends: int = 1
    record: str = ""
    overwrite: bool = False
    journal: str = ""
    resume: bool = False
    autostart: bool = True
    map_frame: str = ""

    def checked(self, configuration: Configuration, inputs: Sequence[Path | None]) -> "RunOptions":
        """Options that can be followed: ``record`` does not overwrite the run's ``inputs``. Raises InputError.

        Without journal and ``resume`` if results depend on timing: such a run cannot be repeated.
        """
        if self.backends < 1:
            raise InputError(f"backends {self.backends}: give at least one backend")
        if self.record and not self.resume:
            check_bag_output(Path(self.record), inputs, self.overwrite, LEAVE_OF_NODES)
        is_timed = configuration.open_world.time_budget_ms > 0
        return replace(self, journal="", resume=False) if is_timed else self

    @property
    def common(self) -> dict[str, Any]:
        """Parameters of every node."""
        return {} if self.autostart else {"autostart": False}


def node_set(
    bag: Path, configuration_file: Path, rate: float, options: RunOptions, *, has_tf2: bool, has_stereo: bool
) -> list[NodeSpec]:
    """Nodes that replay ``bag``, the player last, so that it starts after its listeners. Raises InputError.

    ``rate``: of real time; ``LOSSLESS``: lock-step. ``has_tf2`` False: without tf2_msgs /tf_static cannot be published
    here, so the classifier gets the extrinsics from the bag's transforms as a parameter. ``has_stereo`` False: without
    stereo_msgs disparities cannot be published here, so a bag without other depth is one without depth.
    """
    if rate < LOSSLESS:
        raise InputError(f"rate {rate:g}: give a rate of 0 or more")
    configuration = load_configuration(configuration_file)
    options = options.checked(configuration, [bag, configuration_file, map_prior_path(bag)])
    source = _Source.of(bag, configuration, has_tf2=has_tf2, has_stereo=has_stereo)
    common = {"lossless": rate == LOSSLESS, "use_sim_time": True} | options.common
    configured = common | changed_parameters(configuration)
    prior = {"map_prior": str(map_prior_path(bag) or ""), "source_bag": str(bag)}
    nodes = _manager_and_backends(configured | prior | source.manager, common, options)
    if not source.has_measurements:
        parameters = configured | source.classifier
        # Messages in flight to a dead classifier are lost; a restarted player sends them again to the new one.
        followers = ("bag_player",) if rate == LOSSLESS else ()
        nodes.append(NodeSpec("classifier_node", "classifier", parameters, followers=followers))
    nodes += _recorders(common, options, has_imu=source.has_imu)
    player = {"bag": str(bag), "rate": rate, "resume": options.resume} | options.common
    return [*nodes, NodeSpec("bag_player", "bag_player", player, again={"resume": True})]


@dataclass(frozen=True, kw_only=True)
class Sensors:
    """What a live robot has.

    ``detections_type``: message type of topic detections, "" for DetectionArray. ``odom_frame``: frame of an odometry
    that comes by /tf alone, "" where topic odom has it. ``has_moving_camera``: /tf tells where the camera is.
    """

    has_images: bool = True
    has_depth: bool = True
    has_moving_camera: bool = False
    has_imu: bool = False
    detections_type: str = ""
    odom_frame: str = ""


def robot_set(
    configuration_file: Path, options: RunOptions, *, sensors: Sensors = Sensors(), map_prior: str = ""
) -> list[NodeSpec]:
    """Nodes of a live robot: those of :func:`node_set` without the player. Raises InputError.

    ``options`` name a journal, which is unused with ``open_world.time_budget_ms``: then the manager's death ends the
    run. ``map_prior``: a saved map or objects.json, "" for none.
    """
    configuration = load_configuration(configuration_file)
    if not options.journal:
        raise InputError("journal is empty; name a folder, from which a manager that dies goes on")
    inputs = [configuration_file, Path(map_prior) if map_prior else None, Path(options.journal)]
    options = options.checked(configuration, inputs)
    common = options.common
    configured = common | changed_parameters(configuration)
    nodes = _manager_and_backends(configured | {"map_prior": map_prior, "has_imu": sensors.has_imu}, common, options)
    classifier = configured | {"has_images": sensors.has_images, "has_depth": sensors.has_depth}
    classifier |= {"has_moving_camera": True} if sensors.has_moving_camera else {}
    classifier |= {"detections_type": sensors.detections_type} if sensors.detections_type else {}
    nodes.append(NodeSpec("classifier_node", "classifier", classifier))
    if sensors.odom_frame:
        frames = {"odom_frame": sensors.odom_frame, "base_frame": configuration.perception.base_frame}
        nodes.append(NodeSpec("tf_odometry_node", "tf_odometry", common | frames))
    return [*nodes, *_recorders(common, options, has_imu=sensors.has_imu)]


def _manager_and_backends(manager: dict[str, Any], common: dict[str, Any], options: RunOptions) -> list[NodeSpec]:
    """The manager first; without a journal its death ends the run."""
    restarts = {"resume": True} if options.journal else None
    manager = manager | {"backends": options.backends, "journal": options.journal, "resume": options.resume}
    manager |= {"map_frame": options.map_frame} if options.map_frame else {}
    return [
        NodeSpec("hypothesis_manager_node", "hypothesis_manager", manager, again=restarts),
        *(NodeSpec("backend_node", f"backend_{n}", common | {"backend_id": n}) for n in range(options.backends)),
    ]


def _recorders(common: dict[str, Any], options: RunOptions, *, has_imu: bool) -> list[NodeSpec]:
    """One, or none where nothing is to be recorded."""
    if not options.record:
        return []
    parameters = {"bag": options.record, "overwrite": options.overwrite, "resume": options.resume}
    imu = {"has_imu": True} if has_imu else {}
    return [NodeSpec("bag_recorder", "bag_recorder", common | parameters | imu, again={"resume": True})]


@dataclass(frozen=True)
class _Source:
    """What nodes must be told of the bag that is replayed."""

    has_measurements: bool  # made by an earlier run, so that no classifier is needed
    has_imu: bool  # of use
    manager: dict[str, Any]  # parameters
    classifier: dict[str, Any]  # parameters

    @classmethod
    def of(cls, bag: Path, configuration: Configuration, *, has_tf2: bool, has_stereo: bool) -> "_Source":
        """Raises InputError."""
        with BagReader(bag) as reader:
            found = find_topics(bag, reader.topics)
            if found.depth == absolute(topics.DISPARITY) and not has_stereo:
                found = replace(found, depth="")
            extrinsics = [] if has_tf2 else _extrinsics(reader, found, configuration)
            imu = _imu_parameters(reader, found, configuration, has_tf2=has_tf2)
            labels = _labels(reader, found, configuration, map_prior_path(bag))
            is_without_body = not _places_body(reader, found, configuration.perception.base_frame)
        odom = {"broadcast_odom": True} if has_tf2 and is_without_body else {}  # so that RViz can place the robot
        return cls(
            has_measurements=bool(found.measurements),
            has_imu=bool(imu),
            manager={**odom, **imu, **labels},
            classifier=_classifier_parameters(found, extrinsics),
        )


def _labels(
    reader: BagReader, found: InputTopics, configuration: Configuration, map_prior: Path | None
) -> dict[str, Any]:
    """Parameter with all labels of the bag, where labels are the classes; live, only the first one would be known."""
    if configuration.semantic_model.labels or class_model_kind(configuration.semantic_model).labels is None:
        return {}
    prior = read_map_prior(map_prior) if map_prior is not None else None
    known = known_labels(configuration, labels_in(reader, found.measurements or found.detections), prior)
    return {"semantic_model.labels": list(known)} if known else {}


def _places_body(reader: BagReader, found: InputTopics, base_frame: str) -> bool:
    """Whether one of the bag's first ``FIRST_TRANSFORMS`` messages on /tf has the base frame as a child."""
    messages = islice(reader.messages([found.transforms]), FIRST_TRANSFORMS) if found.transforms else ()
    return any(
        plain_frame(transform.child_frame_id) == base_frame
        for message in messages
        for transform in reader.decode(message.cdr, message.type_name).transforms
    )


def _classifier_parameters(found: InputTopics, extrinsics: list[float]) -> dict[str, Any]:
    parameters: dict[str, Any] = {
        "has_images": found.has_images,
        "has_depth": bool(found.depth),
        "has_moving_camera": found.has_images and bool(found.transforms) and not extrinsics,
        "compressed": found.image == absolute(topics.IMAGE_COMPRESSED),
        "depth_compressed": found.depth == absolute(topics.DEPTH_COMPRESSED),
    }
    return parameters | ({"perception.extrinsics": extrinsics} if extrinsics else {})


def _imu_parameters(
    reader: BagReader, found: InputTopics, configuration: Configuration, *, has_tf2: bool
) -> dict[str, Any]:
    """Manager parameters for topic imu; empty if the bag has none or the configuration does not use it."""
    first = next(iter(reader.messages([found.imu])), None) if found.imu else None
    if first is None or unused_because(configuration):
        return {}
    if has_tf2 or configuration.imu.extrinsics:
        return {"has_imu": True}
    frame_id, tree = reader.decode(first.cdr, first.type_name).header.frame_id, read_preamble(reader).transforms
    with suppress(InputError):  # the run counts the missing transform
        pose = sensor_pose((), configuration.perception.base_frame, tree, frame_id)
        return {"has_imu": True, "imu.extrinsics": pose.tolist()}
    return {"has_imu": True}


def _extrinsics(reader: BagReader, found: InputTopics, configuration: Configuration) -> list[float]:
    """(7,) T_base_camera of the bag's camera; [] if the configuration gives it or there is none. Raises InputError."""
    perception = configuration.perception
    camera_info = next(iter(reader.messages([found.camera_info])), None) if found.camera_info else None
    if perception.extrinsics or camera_info is None:
        return []
    camera = reader.decode(camera_info.cdr, camera_info.type_name)
    tree = read_preamble(reader).transforms
    try:
        pose = sensor_pose((), perception.base_frame, tree, camera.header.frame_id)
    except InputError:
        if found.has_images and not found.transforms:
            raise
        return []  # detections with positions need no camera, and a moving camera's pose comes from /tf
    return [float(value) for value in pose]
