"""Which nodes a replay consists of, with which parameters: the launch file and the demo both start these."""

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
"""The rate that stands for lock-step: as fast as the nodes can follow, and nothing is lost."""


@dataclass(frozen=True)
class NodeSpec:
    """One process: an executable of this package, the node's name, and the parameters that are not at their default.

    When it dies it is started again with the parameters of ``again`` besides; None: the run ends. ``followers`` are
    nodes that are then started anew, too.
    """

    executable: str
    name: str
    parameters: dict[str, Any] = field(default_factory=dict)
    again: dict[str, Any] | None = field(default_factory=dict)
    followers: tuple[str, ...] = ()

    def anew(self) -> "NodeSpec":
        """The process in place of one that died."""
        return replace(self, parameters=self.parameters | (self.again or {}))


def node_set(
    bag: Path,
    configuration_file: Path,
    backends: int,
    rate: float,
    record: str,
    *,
    has_tf2: bool,
    overwrite: bool = False,
    journal: str = "",
    resume: bool = False,
    autostart: bool = True,
) -> list[NodeSpec]:
    """Nodes that replay ``bag``; those that listen come first. Raises InputError.

    ``record`` names the belief bag to write, "" for none; an old one is replaced with ``overwrite`` alone. ``journal``
    is the manager's, "" for none: then its death ends the run. With ``resume`` journal and belief bag of a run that was
    broken off are gone on with. Without ``autostart`` the nodes wait for the transitions of their lifecycle. Without
    tf2_msgs (``has_tf2``) nobody can publish /tf_static here, and the classifier is given the extrinsics that the bag's
    transforms say.
    """
    if backends < 1 or rate < LOSSLESS:
        raise InputError(f"backends {backends}, rate {rate:g}: give at least one backend and a rate of 0 or more")
    if record and not resume:
        check_bag_output(Path(record), [bag, configuration_file, map_prior_path(bag)], overwrite, LEAVE_OF_NODES)
    configuration = load_configuration(configuration_file)
    if configuration.open_world.time_budget_ms > 0:  # what is found in time cannot be repeated
        journal, resume = "", False
    with BagReader(bag) as reader:
        found = find_topics(bag, reader.topics)
        extrinsics = [] if has_tf2 else _extrinsics(reader, found, configuration)
        imu = _imu_parameters(reader, found, configuration, has_tf2=has_tf2)
        labels = _labels(reader, found, configuration, map_prior_path(bag))
        is_without_body = not _places_body(reader, found, configuration.perception.base_frame)
    waiting: dict[str, Any] = {} if autostart else {"autostart": False}
    common = {"lossless": rate == LOSSLESS, "use_sim_time": True} | waiting
    configured = common | changed_parameters(configuration)
    manager = configured | {
        "backends": backends,
        "map_prior": str(map_prior_path(bag) or ""),
        "source_bag": str(bag),
        "journal": journal,
        "resume": resume,
        **({"broadcast_odom": True} if has_tf2 and is_without_body else {}),  # or RViz could not place the robot
        **imu,
        **labels,
    }
    restarts = {"resume": True} if journal else None
    nodes = [NodeSpec("hypothesis_manager_node", "hypothesis_manager", manager, again=restarts)]
    nodes += [NodeSpec("backend_node", f"backend_{n}", common | {"backend_id": n}) for n in range(backends)]
    if not found.measurements:
        parameters = configured | _classifier_parameters(found, extrinsics)
        # What was on the way to a classifier that died, its successor is sent by a player that begins there.
        followers = ("bag_player",) if rate == LOSSLESS else ()
        nodes.append(NodeSpec("classifier_node", "classifier", parameters, followers=followers))
    if record:
        recorder = common | {"bag": record, "overwrite": overwrite, "resume": resume}
        recorder |= {"has_imu": True} if imu else {}
        nodes.append(NodeSpec("bag_recorder", "bag_recorder", recorder, again={"resume": True}))
    player = {"bag": str(bag), "rate": rate, "resume": resume} | waiting
    return [*nodes, NodeSpec("bag_player", "bag_player", player, again={"resume": True})]


def _labels(
    reader: BagReader, found: InputTopics, configuration: Configuration, map_prior: Path | None
) -> dict[str, Any]:
    """The parameter that names all labels of the bag where they mean something: live the first alone would be known."""
    if configuration.semantic_model.labels or class_model_kind(configuration.semantic_model).labels is None:
        return {}
    prior = read_map_prior(map_prior) if map_prior is not None else None
    known = known_labels(configuration, labels_in(reader, found.measurements or found.detections), prior)
    return {"semantic_model.labels": list(known)} if known else {}


def _places_body(reader: BagReader, found: InputTopics, base_frame: str) -> bool:
    """Whether the bag's transforms say where the robot's body is, as far as its first ones show."""
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
    """The parameters that have the manager listen to topic imu, where the bag has it and the run a use for it."""
    first = next(iter(reader.messages([found.imu])), None) if found.imu else None
    if first is None or unused_because(configuration):
        return {}
    if has_tf2 or configuration.imu.extrinsics:
        return {"has_imu": True}
    frame_id, tree = reader.decode(first.cdr, first.type_name).header.frame_id, read_preamble(reader).transforms
    with suppress(InputError):  # which the run counts
        pose = sensor_pose((), configuration.perception.base_frame, tree, frame_id)
        return {"has_imu": True, "imu.extrinsics": pose.tolist()}
    return {"has_imu": True}


def _extrinsics(reader: BagReader, found: InputTopics, configuration: Configuration) -> list[float]:
    """T_base_camera of the bag's camera; [] where the configuration gives it or there is none."""
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
        return []  # detections that tell places need no camera, and one that moves is told of at every instant
    return [float(value) for value in pose]
