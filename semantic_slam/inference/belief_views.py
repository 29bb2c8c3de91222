"""Views of a belief as one record per object and per hypothesis, instead of as arrays."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import planar_from_pose_vector


@dataclass(frozen=True, kw_only=True)
class HypothesisEstimate:
    """One association hypothesis: its weight, and the robot's pose under it."""

    hypothesis_id: int
    parent_id: int  # hypothesis of the previous belief
    weight: float  # normalised: the weights of all hypotheses kept sum to 1
    pose: Array  # (7,) robot in map: x y z qx qy qz qw
    covariance: Array  # (6, 6) x y z rx ry rz along the axes of map
    associations: tuple[int, ...]  # object id of each detection of this keyframe, -1 clutter

    @property
    def position(self) -> Array:
        """(3,) metres in map."""
        return self.pose[:3]

    @property
    def yaw_rad(self) -> float:
        """Heading in map, counter-clockwise from x."""
        return float(planar_from_pose_vector(self.pose)[2])


@dataclass(frozen=True)
class ObjectPlace:
    """One of the places where an object may be."""

    probability: float  # that it is there, if it exists
    position: Array  # (3,) metres in map
    covariance: Array  # (3, 3)


@dataclass(frozen=True, kw_only=True)
class ObjectEstimate:
    """Estimate of one object, marginalised over all hypotheses."""

    object_id: int
    name: str
    existence: float  # probability
    class_probabilities: dict[str, float]  # {} without class models
    pose: Array  # (7,) in map: x y z qx qy qz qw
    covariance: Array  # (6, 6) x y z rx ry rz along the axes of map, moment-matched over hypotheses
    places: tuple[ObjectPlace, ...]  # one where the hypotheses agree, else several, likeliest first

    @property
    def position(self) -> Array:
        """(3,) metres in map."""
        return self.pose[:3]

    @property
    def yaw_rad(self) -> float:
        """Heading in map, counter-clockwise from x."""
        return float(planar_from_pose_vector(self.pose)[2])

    @property
    def likeliest_class(self) -> str:
        """The class of the largest probability, "" without class models."""
        return max(self.class_probabilities, key=lambda name: self.class_probabilities[name], default="")

    def row(self) -> dict[str, object]:
        """The object as a table row: metres, radians, standard deviations, and a column ``p_<class>`` per class."""
        x, y, z = self.position.tolist()
        sigmas = np.sqrt(np.diagonal(self.covariance))
        return {
            "object_id": self.object_id,
            "name": self.name,
            "existence": self.existence,
            "x_m": x,
            "y_m": y,
            "z_m": z,
            "yaw_rad": self.yaw_rad,
            "sigma_x_m": float(sigmas[0]),
            "sigma_y_m": float(sigmas[1]),
            "sigma_z_m": float(sigmas[2]),
            "sigma_yaw_rad": float(sigmas[5]),
            "likeliest_class": self.likeliest_class,
            **{f"p_{name}": p for name, p in self.class_probabilities.items()},
        }
