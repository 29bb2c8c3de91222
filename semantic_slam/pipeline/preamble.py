"""What has to be known before the first keyframe: fixed transforms, the initial pose, the map prior."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from semantic_slam.bag.reader import BagReader, TruncatedBagError
from semantic_slam.errors import MessageError
from semantic_slam.geometry.pose import planar_from_covariance
from semantic_slam.inference.world.map_prior import MapPrior, read_map_prior
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message
from semantic_slam.messages.sensor import TransformTree, plain_frame
from semantic_slam.messages.standard import PoseEstimate, is_pose

MAP_FRAME = "map"
MAP_PRIOR_FILE = "objects.json"
ROUNDING = 1e-12


@dataclass
class Preamble:
    """Collected over the whole bag, wherever in it these messages lie."""

    transforms: TransformTree = field(default_factory=TransformTree)
    initial_pose: PoseEstimate | None = None  # in map; the first one of the bag
    labels: frozenset[str] = frozenset()  # of all detections, where it matters what a detector can say


def read_preamble(reader: BagReader) -> Preamble:
    """Static transforms and initial pose of a bag; raises InputError when the initial pose is not usable."""
    preamble = Preamble()
    try:
        for message in reader.messages([topics.TF_STATIC, topics.INITIAL_POSE]):
            content = reader.decode(message.cdr, message.type_name)
            if message.topic == topics.TF_STATIC:
                preamble.transforms.add(content)
            elif preamble.initial_pose is None:
                preamble.initial_pose = checked_initial_pose(from_message(content))
    except TruncatedBagError:
        pass  # the run meets the same damage, and reports it
    return preamble


def checked_initial_pose(estimate: PoseEstimate, frame: str = MAP_FRAME) -> PoseEstimate:
    """The initial pose, its quaternion of length 1; raises MessageError when it is not in the map's frame, or no pose.

    Its covariance over x, y and yaw has to be one: all zeros are what publishers send that do not know it.
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
    if abs(length - 1.0) <= ROUNDING:  # to the last bit as it is
        return estimate
    return replace(estimate, pose=np.append(estimate.pose[:3], estimate.pose[3:] / length))


def find_map_prior(bag: Path) -> MapPrior | None:
    """The map prior that lies beside the bag's data, announced in a line; None when there is none."""
    path = map_prior_path(bag)
    if path is None:
        return None
    print(f"map prior: {path}")
    return read_map_prior(path)


def map_prior_path(bag: Path) -> Path | None:
    """``objects.json`` in a bag's folder; for a bare file NAME.mcap, NAME.objects.json beside it, else objects.json."""
    folder = bag if bag.is_dir() else bag.parent
    names = (MAP_PRIOR_FILE,) if bag.is_dir() else (f"{bag.stem}.{MAP_PRIOR_FILE}", MAP_PRIOR_FILE)
    return next((folder / name for name in names if (folder / name).is_file()), None)
