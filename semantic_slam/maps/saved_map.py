"""Saved map: marginals of its objects, and joint Gaussians per hypothesis."""

from dataclasses import dataclass, field

import numpy as np

from semantic_slam.configuration.configuration import PLANAR
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.geometry.object_coordinates import ObjectCoordinates, object_coordinates
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.inference.protocol import source_entry
from semantic_slam.inference.states.identity import digest
from semantic_slam.text_files import parse_json

RECORDING = "recording:"
"""Prefix that tells the id of a recording from that of a map."""


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Origin of a map; "" for unknown fields."""

    source: str = ""  # JSON: path and sha256 of the bag, or "merged" maps
    revision: str = ""  # of the software
    configuration_sha256: str = ""
    run_id: str = ""
    began_ns: int = 0  # stamp of the run's first keyframe; 0: not known, as in files of before
    started_from: str = ""  # id of the map that the run started from
    keyframe: int = -1  # of the belief
    stamp_ns: int = 0
    ancestors: tuple[str, ...] = ()  # sorted ids of all maps, and of their recordings, whose information it
    # holds; older files state none

    @property
    def recording(self) -> str:
        """Id of what the run has observed: of its bag, else of a live run by its id and first stamp; "" for unknown.

        Live runs of one configuration have one run id.
        """
        bag = source_entry(self.source, "sha256")
        live = f"{self.run_id} {self.began_ns}" if self.run_id and self.began_ns else ""
        return f"{RECORDING}{digest(bag or live)}" if bag or live else ""

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
        """Ids of all maps whose information this one holds: those it was started or merged from, and their own.

        Ids of the recordings of these maps are among them.
        """
        return self.provenance.parents.union(self.provenance.ancestors)

    @property
    def origins(self) -> frozenset[str]:
        """Ids of its ancestors, and of the recording that it was made of."""
        return self.ancestors.union({self.provenance.recording} - {""})


def have_common_ancestor(one: SavedMap, other: SavedMap) -> bool:
    """Whether both maps hold, at whatever remove, information of one map or of one recording."""
    return not one.origins.isdisjoint(other.origins)


def are_of_one_recording(one: SavedMap, other: SavedMap) -> bool:
    """Whether the runs of both maps have observed the same."""
    return one.provenance.recording == other.provenance.recording != ""


def are_of_one_run(one: SavedMap, other: SavedMap) -> bool:
    """Whether one run has made both maps, the later of which holds all that is in the earlier."""
    return are_of_one_recording(one, other) and one.provenance.run_id == other.provenance.run_id


def share_evidence(one: SavedMap, other: SavedMap) -> bool:
    """Whether one map holds the other, or both hold information of a third, or of one recording."""
    origins = [known.origins.union({known.map_id} - {""}) for known in (one, other)]
    return not origins[0].isdisjoint(origins[1])
