"""Examination of a running system for ``doctor``: the bag checks on live messages, and checks of the ROS graph."""

from array import array
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rcl_interfaces.srv import GetParameters
from rclpy.parameter import parameter_value_to_python

from semantic_slam.bag.mcap_stream import RawMessage
from semantic_slam.bag.names import absolute
from semantic_slam.configuration import load_configuration
from semantic_slam.datasets.user_bag.detection_formats import READERS
from semantic_slam.doctor.checks import graph as graph_checks
from semantic_slam.doctor.checks.graph import CLASSIFIER, MANAGER
from semantic_slam.doctor.examination import examine
from semantic_slam.doctor.finding import Finding, error, of_fault, warning
from semantic_slam.doctor.graph import Endpoint, Graph
from semantic_slam.doctor.input_summary import InputSummary, Stamps
from semantic_slam.doctor.summarise import Summariser
from semantic_slam.errors import InputError
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.maps.map_file import read_map_prior
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message
from semantic_slam.messages.standard import MAP_FRAME
from semantic_slam.messages.topics import LATCHED, TYPES
from semantic_slam.messages.typestore import deserialize
from semantic_slam.pipeline.gravity.imu_use import unused_because
from semantic_slam.pipeline.input_topics import offered
from semantic_slam.pipeline.preamble import Preamble, checked_initial_pose
from semantic_slam.ros.node.parameters import configuration_of, leaves
from semantic_slam.ros.observers.observation import MOST_BYTES, READ_HERE, Observer, observer
from semantic_slam.ros.wire.transport import is_installed

ANSWER_S = 2.0
NODES_TO_COME = Endpoint("any node of ours", "", is_reliable=True, is_latched=True)
"""Assumed subscription, of a node that may start later, to latched inputs."""
RELATIVE = {absolute(topic): topic for topic in READ_HERE}


def examine_running_system(
    configuration: Path | None, map_prior: Path | None, seconds: float, ros_arguments: Sequence[str] = ()
) -> list[Finding]:
    """Findings on the running system, observed for some seconds. Raises InputError for invalid arguments.

    Without ``configuration`` the parameters of the running nodes are used, or the defaults if there are none.
    """
    given = read_map_prior(map_prior) if map_prior else None
    with observer(ros_arguments) as look:
        graph = look.observe(seconds, wanted)
        parameters = {} if configuration else _parameters(look)
        map_frame = str(_asked(look, MANAGER, ["map_frame"]).get("map_frame", ""))
    kinds = published(graph)
    types = {topic: TYPES[RELATIVE[topic]] if _is_foreign(topic, kind) else kind for topic, kind in kinds.items()}
    prior, unread = (given, []) if given else prior_of_manager(parameters.get("map_prior") or "")
    summary = InputSummary(
        configuration=load_configuration(configuration) if configuration else configuration_of(parameters, MANAGER),
        prior=prior,
        types=types,
        counts=look.heard,
        found=offered(types),
        preamble=Preamble(),
        is_live=True,
    )
    faults = [
        *unread,
        *unheard(graph, look.heard),
        *fill_preamble(summary.preamble, look.messages, map_frame),
        *unread_imu(summary, parameters),
    ]
    Summariser(summary, deserialize).take(look.messages)
    faults += _left_out(look, summary)
    found = [*graph_checks.check(with_nodes_to_come(graph)), *faults, *examine(summary)]
    return [finding.renamed(look.names) for finding in found]


def prior_of_manager(name: str) -> tuple[MapPrior | None, list[Finding]]:
    """The map prior of a running manager, if its file is accessible here, and findings on that file."""
    path = Path(name)
    try:
        return read_map_prior(path) if path.is_file() else None, []
    except InputError as fault:
        return None, [of_fault("map prior", fault)]


def _left_out(look: Observer, summary: InputSummary) -> Iterator[Finding]:
    """Findings on images that were too many to be kept; their stamps are added to the summary."""
    for topic, times in look.left_out.items():
        header_ns, arrival_ns = np.array(times, dtype=np.int64).T
        kept = summary.stamps_of(topic)
        summary.stamps[topic] = Stamps(np.append(kept.header_ns, header_ns), np.append(kept.arrival_ns, arrival_ns))
        what = f"{len(times)} of {look.heard[topic]} pictures of {topic} are left out but for their stamps"
        yield warning("pictures", f"{what}: there are more than {MOST_BYTES / 1e6:.0f} MB", "give fewer --seconds")


def wanted(graph: Graph) -> dict[str, str]:
    """Types, by relative name, of inputs that are published and whose packages are installed."""
    read = _without_unread(published(graph))
    return {RELATIVE[topic]: kind for topic, kind in read.items() if is_installed(kind)}


def _without_unread(kinds: Mapping[str, str]) -> dict[str, str]:
    """Types without those of pictures that come on another topic, too, from which they are read."""
    found = offered(kinds)
    depths = {absolute(topic) for topic in (topics.DEPTH, topics.DISPARITY)} if found.depth else set[str]()
    unread = {found.image and absolute(topics.IMAGE), *depths} - {found.image, found.depth}
    return {topic: kind for topic, kind in kinds.items() if topic not in unread}


def unheard(graph: Graph, heard: Counter[str]) -> Iterator[Finding]:
    """Findings on inputs to be read whose packages are not installed; they are added to the messages ``heard``."""
    for topic, kind in _without_unread(published(graph)).items():
        if not is_installed(kind):
            heard[topic] += 1  # so that it is not also reported as silent
            package = kind.partition("/")[0]
            what = f"{topic} is {kind}, and its package is not installed here"
            instead = "publish depth images" if topic == absolute(topics.DISPARITY) else "give perception.extrinsics"
            yield error("topics", what, f"install ros-jazzy-{package.replace('_', '-')}, or {instead}")


def published(graph: Graph) -> dict[str, str]:
    """Type of every input that has a publisher; measurements count only if detections are not published."""
    kinds = {topic: found[0].type_name for topic, found in graph.publishers.items() if found}
    if absolute(topics.DETECTIONS) in kinds:
        kinds.pop(topics.MEASUREMENTS, None)
    return kinds


def with_nodes_to_come(graph: Graph) -> Graph:
    """The graph with assumed subscriptions to latched inputs, as nodes that start later receive them, too."""
    readers = {
        absolute(topic): [replace(NODES_TO_COME, type_name=TYPES[topic])]
        for topic in LATCHED & set(READ_HERE)
        if not graph.readers.get(absolute(topic))
    }
    return replace(graph, readers={**graph.readers, **readers})


def unread_imu(summary: InputSummary, parameters: Mapping[str, Any]) -> Iterator[Finding]:
    """Finding on a published topic imu that the manager is not configured to use."""
    if summary.found.imu and parameters.get("has_imu") is False and not unused_because(summary.configuration):
        what = f"{summary.found.imu} is published and {MANAGER} does not listen to it"
        yield warning("topics", what, f"start {MANAGER} with -p has_imu:=true")


def _is_foreign(topic: str, kind: str) -> bool:
    """Whether the topic has detections of another package, which the classifier can read."""
    return topic == absolute(topics.DETECTIONS) and kind in READERS


def fill_preamble(preamble: Preamble, messages: Iterable[RawMessage], map_frame: str) -> list[Finding]:
    """Fill ``preamble`` with static transforms and the initial pose among the messages; returns findings on them.

    ``map_frame`` is that of the running manager. Where it is "", for there is none, a pose may be in the frame map of
    any namespace.
    """
    faults = []
    for message in messages:
        try:
            if message.topic == topics.TF_STATIC:
                preamble.transforms.add(deserialize(message.cdr, message.type_name))
            elif message.topic == absolute(topics.INITIAL_POSE):
                estimate = from_message(deserialize(message.cdr, message.type_name))
                is_map = estimate.frame_id.endswith(f"/{MAP_FRAME}")
                expected = map_frame or (estimate.frame_id if is_map else MAP_FRAME)
                preamble.initial_pose = checked_initial_pose(estimate, expected)
        except InputError as fault:
            faults.append(of_fault("initial pose", fault))
    return faults


def _parameters(look: Observer) -> dict[str, Any]:
    """Configuration of the running nodes by dotted names; ``perception.*`` is read from the classifier."""
    names = [name for name, _, _ in leaves()]
    sensing = [name for name in names if name.startswith("perception.")]
    return {**_asked(look, MANAGER, [*names, "map_prior", "has_imu"]), **_asked(look, CLASSIFIER, sensing)}


def _asked(look: Observer, node: str, names: Sequence[str]) -> dict[str, Any]:
    """Parameters of a node; empty if it does not exist or does not answer."""
    client = look.node.create_client(GetParameters, f"{node}/get_parameters")
    try:
        if not client.service_is_ready():
            return {}
        answer = client.call_async(GetParameters.Request(names=list(names)))
        look.spin(ANSWER_S, until=answer.done)
        values = answer.result().values if answer.done() else []
        told = zip(names, map(parameter_value_to_python, values), strict=False)
        return {
            name: value.tolist() if isinstance(value, array) else value for name, value in told if value is not None
        }
    finally:
        look.node.destroy_client(client)
