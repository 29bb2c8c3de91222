"""Saved map: marginals of its objects, and joint Gaussians per hypothesis."""

from dataclasses import dataclass, field

import numpy as np

from semantic_slam.configuration.configuration import PLANAR
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.geometry.object_coordinates import ObjectCoordinates, object_coordinates
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.text_files import parse_json


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Origin of a map; "" for unknown fields."""

    source: str = ""  # JSON: path and sha256 of the bag, or "merged" maps
    revision: str = ""  # of the software
    configuration_sha256: str = ""
    run_id: str = ""
    started_from: str = ""  # id of the map that the run started from
    keyframe: int = -1  # of the belief
    stamp_ns: int = 0
    ancestors: tuple[str, ...] = ()  # sorted ids of all maps whose information it holds; older files state none

    @property
    def parents(self) -> frozenset[str]:
        """Ids of the maps that it was started from, or merged from."""
        try:
            entries = parse_json(self.source or "{}")
        except ValueError:
            entries = {}
        merged = entries.get("merged") if isinstance(entries, dict) else None
        named = [own for own in merged if isinstance(own, str)] if isinstance(merged, list) else []
        return frozenset((self.started_from, *named)) - {""}


@dataclass(frozen=True, kw_only=True)
class MapObjects:
    """Marginals of O objects over all hypotheses; C classes, L descriptor dimensions."""

    ids: Index  # (O,) 0 <= id < 2^32, each once
    names: tuple[str, ...]  # (O,)
    poses: Array  # (O, 7) x y z qx qy qz qw
    covariances: Array  # (O, 6, 6) x y z rx ry rz along the axes of map
    existence: Array  # (O,)
    class_probabilities: Array  # (O, C)
    class_priors: Array  # (O, C) class probabilities before the object's own evidence; or NaN
    descriptors: Array  # (O, L) NaN where not known
    descriptor_variances: Array  # (O, L)
    missing: Array  # (O,) probability that it is gone; NaN where the run did not estimate it
    moved: Array  # (O,) probability that it was displaced relative to the initial map; or NaN
    sightings: Array  # (O,) detections of it in the heaviest hypothesis; NaN where not known

    def __len__(self) -> int:
        return len(self.ids)


@dataclass(frozen=True, kw_only=True)
class MapHypotheses:
    """H hypotheses, heaviest first, each a joint Gaussian over its objects among the O."""

    log_weights: Array  # (H,) normalised natural logs
    existence: Array  # (H, O) 0 for objects absent from a hypothesis
    class_probabilities: Array  # (H, O, C)
    states: Array  # (H, O, 3) x, y, yaw in map, or in space x, y, z; NaN where absent
    covariances: Array  # (H, 3 O, 3 O) in the map frame; NaN where absent

    def __len__(self) -> int:
        return len(self.log_weights)

    @property
    def present(self) -> Flags:
        """(H, O) which objects are present in each hypothesis."""
        return np.asarray(np.isfinite(self.states).all(axis=-1))


@dataclass(frozen=True, kw_only=True)
class ViewedFrom:
    """Poses from which the robot looked, and the sensor region, in the plane: objects in no look may exist unseen."""

    path: Array = field(default_factory=lambda: np.zeros((0, 3)))  # (K, 3) x, y, yaw in map; none: not known
    region: Array = field(default_factory=lambda: np.zeros(4))  # direction, full angle [rad], least, largest range [m]

    def counts(self, points: Array) -> Array:
        """(n,) number of looks with each of (n, 2) points in the sensor region."""
        direction, angle, least, largest = self.region
        off = points[:, None] - self.path[None, :, :2]
        distance = np.linalg.norm(off, axis=-1)
        bearing = wrap_angle(np.arctan2(off[..., 1], off[..., 0]) - self.path[:, 2] - direction)
        return np.asarray(((distance > least) & (distance < largest) & (np.abs(bearing) < 0.5 * angle)).sum(axis=1))


@dataclass(frozen=True, kw_only=True)
class SavedMap:
    """Map of objects in the frame ``map``, the reference frame of all states here."""

    class_names: tuple[str, ...]  # (C,)
    objects: MapObjects
    hypotheses: MapHypotheses
    has_cross_covariances: bool  # else the objects of a hypothesis count as independent
    looks: ViewedFrom = field(default_factory=ViewedFrom)
    discarded_mass: float = 0.0  # of dropped hypotheses, 0..1
    descriptor_space: str = ""
    state_space: str = PLANAR  # of the run: planar or spatial
    provenance: Provenance = Provenance()
    map_id: str = ""  # digest of the content; "" before it is written

    @property
    def coordinates(self) -> ObjectCoordinates:
        """Coordinates that the hypotheses' states and covariances are over."""
        return object_coordinates(self.state_space)

    @property
    def ancestors(self) -> frozenset[str]:
        """Ids of all maps whose information this one holds: those it was started or merged from, and their own."""
        return self.provenance.parents.union(self.provenance.ancestors)


def have_common_ancestor(one: SavedMap, other: SavedMap) -> bool:
    """Whether both maps were started or merged, however long ago, from one map, whose information both hold."""
    return not one.ancestors.isdisjoint(other.ancestors)
