"""Reads what must be known before the first keyframe: static transforms, the initial pose, the map prior."""

from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from semantic_slam.bag.reader import BagReader, TruncatedBagError
from semantic_slam.errors import InputError, MessageError
from semantic_slam.geometry.pose import planar_from_covariance
from semantic_slam.inference.world.map_prior import MapPrior, read_map_prior
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message
from semantic_slam.messages.sensor import TransformTree, plain_frame
from semantic_slam.messages.standard import MAP_FRAME, PoseEstimate, is_pose
from semantic_slam.pipeline.input_topics import offered
from semantic_slam.pipeline.start_deadline import left_out_as_late, start_deadline_ns

MAP_PRIOR_FILE = "objects.json"
ROUNDING = 1e-12


@dataclass
class Preamble:
    """Static transforms, initial pose and labels, collected from the whole bag."""

    transforms: TransformTree = field(default_factory=TransformTree)
    initial_pose: PoseEstimate | None = (
        None  # in the map frame, however it is named; the first one of the bag, unless it comes late
    )
    late_pose: str = ""  # one line on a first pose that comes too late to be the start
    labels: frozenset[str] = frozenset()  # of all detections, if the class models use labels


def read_preamble(reader: BagReader) -> Preamble:
    """Static transforms and initial pose of a bag; raises InputError if the initial pose is not usable."""
    preamble = Preamble()
    try:
        for message in reader.messages([topics.TF_STATIC]):
            preamble.transforms.add(reader.decode(message.cdr, message.type_name))
    except TruncatedBagError:
        pass  # the run reports the damage
    _read_initial_pose(reader, preamble)
    return preamble


def _read_initial_pose(reader: BagReader, preamble: Preamble) -> None:
    """Fill in the first initial pose, or why it is not used. Raises InputError if it is not usable."""
    try:
        first = next(reader.messages([topics.INITIAL_POSE]), None)
    except TruncatedBagError:
        return
    if first is None:
        return
    found = offered(reader.topics)
    frames = found.measurements or found.detections
    deadline_ns = start_deadline_ns(reader, *({name} - {""} for name in (found.odometry, frames)))
    if deadline_ns is not None and first.stamp_ns > deadline_ns:
        preamble.late_pose = left_out_as_late(first.stamp_ns, deadline_ns)
        return
    estimate = from_message(reader.decode(first.cdr, first.type_name))
    preamble.initial_pose = checked_initial_pose(estimate, _recorded_frame(reader, found.odometry, estimate))


def _recorded_frame(reader: BagReader, odometry: str, estimate: PoseEstimate) -> str:
    """The map frame of a recording: any that the pose states, since the system that was recorded had named it.

    The frame of odometry is none: a pose in that says nothing of the map.
    """
    of_odometry = None
    with suppress(InputError):  # the run reports the damage, or a message that does not decode
        for message in reader.messages([odometry] if odometry else []):
            of_odometry = plain_frame(reader.decode(message.cdr, message.type_name).header.frame_id)
            break
    return MAP_FRAME if plain_frame(estimate.frame_id) in ("", of_odometry) else estimate.frame_id


def checked_initial_pose(estimate: PoseEstimate, frame: str) -> PoseEstimate:
    """The initial pose with a normalised quaternion; raises MessageError if it is not finite or not in ``frame``, map.

    Also raises MessageError unless the covariance over x, y and yaw is positive definite; publishers that do not know
    it send zeros.
    """
    if plain_frame(estimate.frame_id) != plain_frame(frame):
        raise MessageError(f"{topics.INITIAL_POSE}: it is in '{estimate.frame_id}'; publish it in '{frame}'")
    if not is_pose(estimate.pose) or not np.isfinite(estimate.covariance).all():
        raise MessageError(f"{topics.INITIAL_POSE}: pose or covariance are not finite; publish numbers")
    planar = planar_from_covariance(estimate.covariance)
    if not np.allclose(planar, planar.T) or np.linalg.eigvalsh(planar).min() <= 0.0:
        raise MessageError(
            f"{topics.INITIAL_POSE}: its covariance over x, y and yaw is not positive definite; publish how far the"
            " pose may be off, 0.01 for 0.1 m"
        )
    length = float(np.linalg.norm(estimate.pose[3:]))
    if abs(length - 1.0) <= ROUNDING:  # keep it bit for bit
        return estimate
    return replace(estimate, pose=np.append(estimate.pose[:3], estimate.pose[3:] / length))


def find_map_prior(bag: Path) -> MapPrior | None:
    """Read the map prior beside the bag and print a line about it; None if there is none."""
    path = map_prior_path(bag)
    if path is None:
        return None
    print(f"map prior: {path}")
    return read_map_prior(path)


def map_prior_path(bag: Path) -> Path | None:
    """Path of ``objects.json`` in a bag's folder; for a file NAME.mcap, NAME.objects.json or objects.json beside it."""
    folder = bag if bag.is_dir() else bag.parent
    names = (MAP_PRIOR_FILE,) if bag.is_dir() else (f"{bag.stem}.{MAP_PRIOR_FILE}", MAP_PRIOR_FILE)
    return next((folder / name for name in names if (folder / name).is_file()), None)
