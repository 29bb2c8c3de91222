"""The map prior: objects known before the run, in the format of ``objects.json``."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from semantic_slam.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ObjectPrior:
    """Gaussian over the pose of one object in map, and probabilities of its class."""

    object_id: int  # 0 <= id < 2^32, unique in the map
    name: str
    pose: Array  # (7,) x y z qx qy qz qw
    covariance: Array  # (6, 6) x y z rx ry rz along the axes of map, as in PoseWithCovariance
    class_probabilities: dict[str, float]  # {} = uniform over the classes of the belief
    existence: float = 1.0


@dataclass(frozen=True)
class MapPrior:
    """Objects in the frame ``map``."""

    objects: tuple[ObjectPrior, ...] = ()

    def to_json(self) -> str:
        """The text of an ``objects.json``."""
        return json.dumps(
            {"schema_version": 1, "frame": "map", "objects": [_row(prior) for prior in self.objects]}, indent=1
        )


def _row(prior: ObjectPrior) -> dict[str, object]:
    return {
        "id": prior.object_id,
        "name": prior.name,
        "frame": "map",
        "pose": prior.pose.tolist(),
        "covariance": prior.covariance.tolist(),
        "class_probabilities": prior.class_probabilities,
        "existence": prior.existence,
    }


def parse_map_prior(text: str, origin: str) -> MapPrior:
    """Map prior from the text of an ``objects.json``; raises InputError that names ``origin``."""
    try:
        rows = json.loads(text)["objects"]
        objects = tuple(_object(row) for row in rows)
    except (ValueError, KeyError, TypeError) as fault:
        raise InputError(
            f"{origin}: not a map prior ({fault!r}); give an objects.json as bag_to_report writes it"
        ) from None
    ids = [prior.object_id for prior in objects]
    if len(set(ids)) < len(ids):
        raise InputError(f"{origin}: object ids are not unique; number the objects anew")
    return MapPrior(objects)


def read_map_prior(path: Path) -> MapPrior:
    """Map prior from an ``objects.json``; raises InputError when it cannot be read."""
    try:
        return parse_map_prior(path.read_text(encoding="utf-8"), str(path))
    except OSError as fault:
        raise InputError(f"{path}: {fault.strerror}; name an existing objects.json") from None


def _object(row: dict[str, object]) -> ObjectPrior:
    pose = np.asarray(row["pose"], dtype=np.float64)
    covariance = np.asarray(row["covariance"], dtype=np.float64).reshape(6, 6)
    if pose.shape != (7,) or not np.isfinite(pose).all() or not np.isfinite(covariance).all():
        raise ValueError("pose needs 7 and covariance 36 finite numbers")
    return ObjectPrior(
        object_id=int(str(row["id"])),
        name=str(row.get("name", row["id"])),
        pose=pose,
        covariance=covariance,
        class_probabilities={str(k): float(v) for k, v in dict(row.get("class_probabilities") or {}).items()},  # type: ignore[call-overload]
        existence=float(str(row.get("existence", 1.0))),
    )
