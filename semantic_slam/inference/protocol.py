"""Protocol between manager and backends: dataclasses that match the ROS messages of the same names field by field.

A keyframe takes two rounds. Keyframe -> Candidates: every backend weighs the continuations of its hypotheses.
Commit -> Components: the survivors are forked, updated and reported. Whether backends live in this process
or behind topics, a manager sees only :class:`BackendPool`.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.object_table import ObjectTable
from semantic_slam.inference.states.lineage import Lineage, Reassigned

if TYPE_CHECKING:  # the smoothers and GTSAM, which nodes that only read and write messages do without
    from semantic_slam.inference.smoothing.component import Component

LOST = "hypothesis lost"
"""Prefix of the reasons for lost hypotheses, where these are counted together with other dropped data."""


@dataclass(frozen=True, kw_only=True)
class RunConfiguration:
    """All that determines a run besides its keyframes."""

    run_id: str
    stamp_ns: int
    configuration: str  # JSON of the effective configuration
    map_prior: str  # text of an objects.json, "" for none
    initial_pose: Array  # (7,) robot in map
    initial_covariance: Array  # (6, 6)
    class_names: tuple[str, ...]
    source: str = ""  # JSON: path, sha256
    revision: str = ""

    @property
    def source_sha256(self) -> str:
        """SHA-256 of the bag that the run processes, "" where that is not stated."""
        return source_entry(self.source, "sha256")


def source_entry(source: str, name: str) -> str:
    """Value of an entry in the JSON text ``source`` of a run, "" where it is missing or the text is invalid."""
    try:
        entries = json.loads(source or "{}")
    except ValueError:
        return ""
    return str(entries.get(name) or "") if isinstance(entries, dict) else ""


@dataclass(frozen=True, kw_only=True)
class Candidates:
    """K candidates of one backend, grown from P parents; D detections."""

    run_id: str
    keyframe: int
    backend_id: int
    ids: NDArray[np.uint64]  # (K,)
    parent_ids: NDArray[np.uint64]  # (K,)
    associations: NDArray[np.int32]  # (K, D)
    class_assignments: NDArray[np.int32]  # (K, D)
    modes: NDArray[np.uint16]  # (K,)
    changes: tuple[tuple[Reassigned, ...], ...] = ()  # (K,) reassociations of earlier detections; (): none has any
    log_weights: Array  # (K,) parent's log weight + log psi
    effective_sample_sizes: Array  # (K,)
    innovation_nees: Array  # (K,) per degree of freedom, NaN without a detection of a known object
    outlier_probability: Array  # (K, D) that a detection is a geometric outlier of the object that it is associated to
    poses: Array  # (K, 7)
    pose_covariances: Array  # (K, 6, 6)
    object_poses: Array  # (K, D, 7)
    object_covariances: Array  # (K, D, 6, 6)
    expanded_parent_ids: NDArray[np.uint64]  # (P,) hypotheses that were expanded, also those without candidates
    log_mass_not_enumerated: Array  # (P,) in the units of log_weights


@dataclass(frozen=True, kw_only=True)
class Commit:
    """S survivors of pruning and their owners. A lineage is () where the survivor's owner holds its parent."""

    run_id: str
    keyframe: int
    ids: NDArray[np.uint64]  # (S,)
    parent_ids: NDArray[np.uint64]  # (S,)
    steps: Lineage  # (S,) of this keyframe
    log_weights: Array  # (S,) normalised
    owners: NDArray[np.uint32]  # (S,)
    lineages: tuple[Lineage, ...]  # (S,) steps of keyframes 0 .. keyframe - 1, or ()


@dataclass(frozen=True, kw_only=True)
class Components:
    """Marginals of the S smoothed components that a backend now holds; O objects; X lost hypotheses."""

    run_id: str
    keyframe: int
    backend_id: int
    ids: NDArray[np.uint64]  # (S,)
    poses: Array  # (S, 7)
    pose_covariances: Array  # (S, 6, 6)
    object_ids: NDArray[np.uint32]  # (O,)
    objects: ObjectTable  # (S, O, ...) marginals of the objects in each component
    lost_ids: NDArray[np.uint64]  # (X,)
    lost_reasons: tuple[str, ...]  # (X,)
    noise: Array  # (S, N, 2) mean and standard deviation of each inferred noise parameter


@dataclass(frozen=True, kw_only=True)
class MissedKeyframes:
    """Request of a backend that was started late, or restarted, to be sent the keyframes from ``keyframe`` on."""

    run_id: str
    backend_id: int
    keyframe: int


class BackendPool(Protocol):
    """Interface through which the manager reaches its backends, in this process or over topics."""

    backend_ids: tuple[int, ...]

    def start(self, run: RunConfiguration) -> None:
        """Give every backend the run's configuration; they hold the root hypothesis from then on."""

    def begin(self, keyframe: Keyframe) -> None:
        """Have backends in other processes begin round one; :meth:`expand` of the same keyframe then collects it."""

    def expand(self, keyframe: Keyframe) -> list[Candidates]:
        """Round one: the candidates of every backend."""

    def commit(self, commit: Commit) -> list[Components]:
        """Round two: the components of every backend."""

    def offer(self, components: Mapping[int, "Component"]) -> None:
        """Hand over components by hypothesis that the manager has replayed, so that the next commit can use them.

        Backends in other processes do not receive them and rebuild them from lineages.
        """
