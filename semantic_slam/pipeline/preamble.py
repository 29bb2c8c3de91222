"""What has to be known before the first keyframe: fixed transforms, the initial pose, the map prior."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from semantic_slam.bag.reader import BagReader, TruncatedBagError
from semantic_slam.errors import InputError
from semantic_slam.inference.world.map_prior import MapPrior, read_map_prior
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message
from semantic_slam.messages.sensor import TransformTree, plain_frame
from semantic_slam.messages.standard import PoseEstimate

MAP_FRAME = "map"
MAP_PRIOR_FILE = "objects.json"


@dataclass
class Preamble:
    """Collected over the whole bag, wherever in it these messages lie."""

    transforms: TransformTree = field(default_factory=TransformTree)
    initial_pose: PoseEstimate | None = None  # in map; the first one of the bag


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


def checked_initial_pose(estimate: PoseEstimate) -> PoseEstimate:
    """The initial pose itself; raises InputError when it is in another frame than map or not finite."""
    if plain_frame(estimate.frame_id) != MAP_FRAME:
        raise InputError(f"{topics.INITIAL_POSE}: it is in '{estimate.frame_id}'; publish it in '{MAP_FRAME}'")
    is_pose = np.isfinite(estimate.pose).all() and np.linalg.norm(estimate.pose[3:]) > 0.0
    if not is_pose or not np.isfinite(estimate.covariance).all():
        raise InputError(f"{topics.INITIAL_POSE}: pose or covariance are not finite; publish numbers")
    return estimate


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
