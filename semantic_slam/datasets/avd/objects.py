"""The objects of a scene: from a simulator's ground truth, or triangulated where the data set has none."""

import json
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.datasets.avd.scene import AvdScene
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import covariance_from_planar, planar_from_pose_vector, pose_vector_from_planar
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior

POSITION_VARIANCE_M2 = 0.05
HEADING_VARIANCE_RAD2 = 0.0005
UNKNOWN_HEADING_VARIANCE_RAD2 = 10.0
LEVEL_VARIANCE = 1e-6
"""Variance of an object's height [m^2] and tilt [rad^2]: furniture stands on the floor."""
CENTRAL_FRACTION = 0.4
MAX_DEPTH_M = 4.5
"""Depth of the real data set is not dependable beyond."""
LEAST_VIEWS = 3


@dataclass(frozen=True)
class TrueObject:
    """An object whose pose and class are known for certain."""

    object_id: int
    class_name: str
    pose: Array  # (7,) in map


def true_objects(scene: AvdScene) -> tuple[TrueObject, ...]:
    """Objects of ``ground_truth.json``, () where the scene has no such file; raises InputError when it is damaged."""
    path = scene.folder / "ground_truth.json"
    if not path.is_file():
        return ()
    try:
        rows = json.loads(path.read_text(encoding="utf-8"))["objects"]
        return tuple(
            TrueObject(int(row["id"]), str(row["class"]), np.array(row["pose"], dtype=np.float64)) for row in rows
        )
    except (ValueError, KeyError, TypeError) as fault:
        raise InputError(f"{path}: damaged ({fault!r}); render the scene again") from None


def uncertain_prior(objects: Sequence[TrueObject], rng: np.random.Generator) -> MapPrior:
    """What a robot could know beforehand: poses drawn about the truth with the stated variances, no classes."""
    sigma = np.sqrt([POSITION_VARIANCE_M2, POSITION_VARIANCE_M2, HEADING_VARIANCE_RAD2])
    return surveyed_map({known.object_id: known.pose for known in objects}, sigma, rng)


def surveyed_map(poses: Mapping[int, Array], sigma: Array, rng: np.random.Generator) -> MapPrior:
    """Map prior of (7,) true ``poses`` by object id: x, y [m] and yaw [rad] drawn with ``sigma`` (3,), no classes."""
    spread = covariance(np.diag(sigma**2))
    priors = []
    for object_id, true in poses.items():
        pose = pose_vector_from_planar(planar_from_pose_vector(true) + sigma * rng.standard_normal(3), float(true[2]))
        priors.append(
            ObjectPrior(
                object_id=object_id,
                name=f"object_{object_id}",
                pose=pose,
                covariance=spread,
                class_probabilities={},
            )
        )
    return MapPrior(tuple(priors))


def triangulated_prior(scene: AvdScene, max_difficulty: int) -> MapPrior:
    """Objects where boxes, depth and poses put them: positions averaged over the views, headings unknown."""
    points: dict[int, list[Array]] = defaultdict(list)
    for name, image in scene.images.items():
        rows = np.flatnonzero(image.difficulties <= max_difficulty)
        if len(rows) and not image.rebuilt and scene.depth_path(name).is_file():
            depth = scene.depth_m(name)
            for row in rows:
                points[int(image.instance_ids[row])].append(_point(scene, image.T_map_camera, image.boxes[row], depth))
    priors = [_triangulated(scene, number, np.array(points[number])) for number in sorted(points)]
    return MapPrior(tuple(prior for prior in priors if prior is not None))


def covariance(planar: Array) -> Array:
    """(6, 6) from (3, 3) over x, y, yaw, with next to no doubt about height and tilt."""
    return covariance_from_planar(planar) + np.diag([0.0, 0.0, LEVEL_VARIANCE, LEVEL_VARIANCE, LEVEL_VARIANCE, 0.0])


def box_depth(depth_m: NDArray[np.float32], box: Array) -> float:
    """Median depth [m] in the middle of a box, NaN when nothing is valid there."""
    centre, half = 0.5 * (box[:2] + box[2:]), np.maximum(0.5 * CENTRAL_FRACTION * (box[2:] - box[:2]), 1.0)
    low, high = np.maximum(centre - half, 0).astype(int), np.ceil(centre + half).astype(int)
    values = depth_m[low[1] : high[1], low[0] : high[0]]
    valid = values[np.isfinite(values)]
    return float(np.median(valid)) if valid.size else float("nan")


def _point(scene: AvdScene, T_map_camera: Array, box: Array, depth_m: NDArray[np.float32]) -> Array:
    """(3,) in map of the surface in the middle of a box; NaN without usable depth."""
    depth = box_depth(depth_m, box)
    depth = depth if depth <= MAX_DEPTH_M else float("nan")
    u, v = 0.5 * (box[:2] + box[2:])
    ray = np.array([(u - scene.camera.cx) / scene.camera.fx, (v - scene.camera.cy) / scene.camera.fy, 1.0])
    return np.asarray(T_map_camera[:3, :3] @ (ray * depth) + T_map_camera[:3, 3])


def _triangulated(scene: AvdScene, number: int, points: Array) -> ObjectPrior | None:
    """Median of the points, None when too few views have depth."""
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < LEAST_VIEWS:
        return None
    middle = np.median(points, axis=0)
    variance = max(POSITION_VARIANCE_M2, float(np.median((points[:, :2] - middle[:2]) ** 2)))
    pose = pose_vector_from_planar(np.array([middle[0], middle[1], 0.0]), float(middle[2]))
    planar = np.diag([variance, variance, UNKNOWN_HEADING_VARIANCE_RAD2])
    return ObjectPrior(
        object_id=number,
        name=scene.instance_names.get(number, f"object_{number}"),
        pose=pose,
        covariance=covariance(planar),
        class_probabilities={},
    )
