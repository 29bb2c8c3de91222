"""What a manager and its backends say to each other; field by field the messages of the same names.

A keyframe is two rounds. Keyframe -> Candidates: every backend weighs the continuations of its hypotheses.
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
from semantic_slam.inference.states.lineage import LineageStep, Reassigned

if TYPE_CHECKING:  # the smoothers and GTSAM, which nodes that only read and write messages do without
    from semantic_slam.inference.smoothing.component import Component

LOST = "hypothesis lost"
"""How reasons begin for which a hypothesis was given up, where they are counted with what else was dropped."""


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
        """Digest of the bag that the run is of, "" where that is not told."""
        return told_of(self.source, "sha256")


def told_of(source: str, name: str) -> str:
    """What the JSON of a run's source tells under a name, "" where it tells nothing."""
    try:
        told = json.loads(source or "{}")
    except ValueError:
        return ""
    return str(told.get(name) or "") if isinstance(told, dict) else ""


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
    changes: tuple[tuple[Reassigned, ...], ...] = ()  # (K,) to the lineage before this keyframe; (): none has any
    log_weights: Array  # (K,) parent's log weight + log psi
    effective_sample_sizes: Array  # (K,)
    innovation_nees: Array  # (K,) per degree of freedom, NaN without a detection of a known object
    outlier_probability: Array  # (K, D) that a detection's place is an outlier, of the object that it is taken to be of
    poses: Array  # (K, 7)
    pose_covariances: Array  # (K, 6, 6)
    object_poses: Array  # (K, D, 7)
    object_covariances: Array  # (K, D, 6, 6)
    expanded_parent_ids: NDArray[np.uint64]  # (P,)
    log_mass_not_enumerated: Array  # (P,)


@dataclass(frozen=True, kw_only=True)
class Commit:
    """S survivors and their owners. ``lineages`` holds () for a survivor whose parent its owner holds."""

    run_id: str
    keyframe: int
    ids: NDArray[np.uint64]  # (S,)
    parent_ids: NDArray[np.uint64]  # (S,)
    steps: tuple[LineageStep, ...]  # (S,) of this keyframe
    log_weights: Array  # (S,) normalised
    owners: NDArray[np.uint32]  # (S,)
    lineages: tuple[tuple[LineageStep, ...], ...]  # (S,) steps of keyframes 0 .. keyframe - 1, or ()


@dataclass(frozen=True, kw_only=True)
class Components:
    """S smoothed components that a backend now holds; O objects."""

    run_id: str
    keyframe: int
    backend_id: int
    ids: NDArray[np.uint64]  # (S,)
    poses: Array  # (S, 7)
    pose_covariances: Array  # (S, 6, 6)
    object_ids: NDArray[np.uint32]  # (O,)
    objects: ObjectTable  # (S, O, ...) what each component knows of them
    lost_ids: NDArray[np.uint64]  # (X,)
    lost_reasons: tuple[str, ...]  # (X,)
    noise: Array  # (S, N, 2) mean and standard deviation of what each infers of the noise


@dataclass(frozen=True, kw_only=True)
class MissedKeyframes:
    """A backend that was started late, or again, asks to be told the keyframes from ``keyframe`` on."""

    run_id: str
    backend_id: int
    keyframe: int


class BackendPool(Protocol):
    """The one interface through which a manager reaches its backends."""

    backend_ids: tuple[int, ...]

    def start(self, run: RunConfiguration) -> None:
        """Give every backend the run's configuration; they hold the root hypothesis from then on."""

    def expand(self, keyframe: Keyframe) -> list[Candidates]:
        """Round one: the candidates of every backend."""

    def commit(self, commit: Commit) -> list[Components]:
        """Round two: the components of every backend."""

    def offer(self, components: Mapping[int, "Component"]) -> None:
        """Components by hypothesis that the manager has made, for the next commit: to make them again is no use.

        Backends of other processes make them again.
        """
