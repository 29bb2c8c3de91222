"""An open world in the plane, and the shipped spatial engine on the same drive: level, with height and tilt known.

Both have the same noise and sensor. Births and false alarms are even over the region, which has an area A in the plane
and a volume V in space: so that both expect as many, the birth density in space is A / V times that in the plane.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from semantic_slam import Configuration, Detection, Engine, HybridBelief, Keyframe, MapPrior, ObjectPrior
from semantic_slam.geometry import se2
from semantic_slam.geometry.pose import pose_vector_from_planar
from semantic_slam.inference.open_world.planar.region import sensor_region
from semantic_slam.inference.open_world.spatial.region import SpatialRegion

LABELS = ("cup", "bottle", "book")
IN_PLANE = [0, 1, 5]
"""Rows of x, y and yaw among x y z rx ry rz."""
PINNED = 1e-12
"""Variance of height, roll and pitch of the motion and of the start."""
START, START_VARIANCES = np.array([0.0, -2.0, 0.0]), np.array([1e-4, 1e-4, 1e-4])
STEP, STEP_VARIANCES = np.array([0.2, 0.0, 0.05]), np.array([1e-4, 1e-4, 4e-5])
RANGE_SIGMA = 0.05
MAP_SIGMA, HEADING_SIGMA = 0.1, 1e-5
REGION = {"field_of_view_rad": 1.4, "vertical_field_of_view_rad": 1.8, "min_range_m": 0.3, "max_range_m": 4.0}
RATES = {
    "detection_probabilities": [0.5, 0.8, 0.95],
    "clutters_per_frame": [0.01, 0.1, 1.0],
    "birth_densities": [0.01, 0.3],
}

Seen = list[tuple[float, float, str]]
"""Range, bearing and label of a frame's detections."""


@dataclass(frozen=True, kw_only=True)
class FlatWorld:
    """How both engines are configured, and the drive."""

    frames: list[Seen]
    bearing_sigma: float
    objects: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))  # (N, 2) on the map
    world: dict[str, Any] = field(default_factory=dict)  # open_world.*, in the plane
    values: dict[str, Any] = field(default_factory=dict)

    def planar(self) -> tuple[Engine, list[HybridBelief]]:
        objects = enumerate(self.objects.tolist())
        prior = MapPrior(
            tuple(ObjectPrior.planar(n, *p, sigma_m=MAP_SIGMA, sigma_rad=HEADING_SIGMA) for n, p in objects)
        )
        engine = Engine(
            self._configured(self._world),
            prior,
            initial_pose=START,
            initial_covariance=np.diag(START_VARIANCES),
        )
        noise = np.diag([RANGE_SIGMA, self.bearing_sigma]) ** 2
        return engine, [
            engine.process(
                Keyframe.planar(
                    k,
                    motion=STEP,
                    motion_sigmas=np.sqrt(STEP_VARIANCES),
                    detections=[Detection(range_m=r, bearing_rad=b, covariance=noise, label=n) for r, b, n in own],
                )
            )
            for k, own in enumerate(self.frames)
        ]

    def spatial(self) -> tuple[Engine, list[HybridBelief]]:
        ratio = self.area_m2 / self.volume_m3
        densities = [ratio * density for density in self._world["birth_densities"]]
        given = {"state_space": "spatial", "observation": "points"}
        engine = Engine(
            self._configured({**self._world, "birth_densities": densities}, **given),
            MapPrior(tuple(_on_the_floor(n, place) for n, place in enumerate(self.objects))),
            initial_pose=pose_vector_from_planar(START),
            initial_covariance=_full(START_VARIANCES),
        )
        motion = {"motion": pose_vector_from_planar(STEP), "motion_covariance": _full(STEP_VARIANCES)}
        return engine, [
            engine.process(Keyframe.spatial(k, detections=[self._level(*each) for each in own], **motion))
            for k, own in enumerate(self.frames)
        ]

    @property
    def area_m2(self) -> float:
        return sensor_region(self._configured(self._world).open_world).area_m2

    @property
    def volume_m3(self) -> float:
        return SpatialRegion.of(self._configured(self._world).open_world).volume_m3

    @property
    def _world(self) -> dict[str, Any]:
        return {**REGION, **RATES, "occluder_radius_m": 0.0, "least_undetected_share": 1.0, **self.world}

    def _configured(self, world: dict[str, Any], **given: Any) -> Configuration:
        kind = {"kind": "detector", "labels": list(LABELS)}
        return Configuration.of(association="open", semantic_model=kind, open_world=world, **{**self.values, **given})

    def _level(self, range_m: float, bearing_rad: float, label: str) -> Detection:
        return Detection.along(
            [np.cos(bearing_rad), np.sin(bearing_rad), 0.0],
            range_m,
            sigma_range_m=RANGE_SIGMA,
            ray_covariance=self.bearing_sigma**2 * np.eye(3),
            label=label,
        )


def seen_from(
    path: list[np.ndarray], objects: np.ndarray, seen: list[tuple[int, ...]], errors: np.ndarray
) -> list[Seen]:
    """The frames of a robot at poses ``path``, which sees some objects (N, 2), with ``errors`` of [range, bearing]."""
    frames = []
    for pose, numbers, own in zip(path, seen, errors, strict=True):
        body = [se2.between(pose, np.append(objects[n], 0.0))[:2] for n in numbers]
        frames.append(
            [
                (float(np.hypot(*p) + a), float(np.arctan2(p[1], p[0]) + b), LABELS[n % len(LABELS)])
                for p, n, (a, b) in zip(body, numbers, own, strict=False)
            ]
        )
    return frames


def driven(count: int) -> list[np.ndarray]:
    """Poses of a robot that drives as odometry has it."""
    path = [se2.compose(START, STEP)]
    while len(path) < count:
        path.append(se2.compose(path[-1], STEP))
    return path


def _on_the_floor(number: int, place: np.ndarray) -> ObjectPrior:
    return ObjectPrior(
        object_id=number,
        name=f"p{number}",
        pose=np.array([*place, 0.0, 0.0, 0.0, 0.0, 1.0]),
        covariance=np.diag([MAP_SIGMA**2, MAP_SIGMA**2, PINNED, 0.0, 0.0, 0.0]),
        class_probabilities={},
    )


def _full(variances: np.ndarray) -> np.ndarray:
    covariance = PINNED * np.eye(6)
    covariance[IN_PLANE, IN_PLANE] = variances
    return covariance
