"""The hybrid belief that the engine outputs after each keyframe (Eq. 4.4)."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.optional_arrays import fill_left_out, left_out
from semantic_slam.inference.belief_views import HypothesisEstimate, ObjectEstimate, ObjectPlace
from semantic_slam.inference.object_table import OPTIONAL, QUANTITIES, ObjectTable


@dataclass(frozen=True, kw_only=True)
class HybridBelief(ObjectTable):
    """The hybrid belief of one keyframe, field by field HybridBelief.msg.

    H hypotheses, D detections, O objects, C classes, L descriptor dimensions. The fields of :class:`ObjectTable` are
    marginals over the hypotheses, (O, ...). A field that the configured model does not fill is NaN, or empty where its
    length is its own (C, L, N).
    """

    stamp_ns: int
    keyframe: int
    planar: bool
    class_names: tuple[str, ...]  # (C,)
    num_candidates: int
    hypothesis_ids: NDArray[np.uint64]  # (H,)
    parent_ids: NDArray[np.uint64]  # (H,)
    modes: NDArray[np.uint16]  # (H,)
    log_weights: Array  # (H,) normalised natural logs
    poses: Array  # (H, 7) robot in map
    pose_covariances: Array  # (H, 6, 6)
    detection_ids: NDArray[np.uint32]  # (D,)
    associations: NDArray[np.int32]  # (H, D) index into object_ids, -1 clutter
    object_ids: NDArray[np.uint32]  # (O,)
    object_names: tuple[str, ...]  # (O,)
    hypothesis_class_probabilities: Array  # (H, O, C)
    association_entropy: float  # nats
    component_entropy: float  # nats
    discarded_mass: float
    dropped: int
    num_merged: int = 0  # near-duplicate candidates merged into a heavier hypothesis in this keyframe
    reproducible: bool = True  # False where a time budget, and thus the wall clock, limits the hypotheses
    log_evidence: float = np.nan  # nats, log P(Z_k | Z_1:k-1) under the hypotheses kept
    innovation_nees: float = np.nan  # of this keyframe's detections under the predicted belief, per degree of freedom
    unexplained: float = np.nan  # posterior probability of the null model, see ``Reference``
    discarded_mass_window: float = np.nan  # discarded_mass over the last keyframes alone
    association_probabilities: Array = field(
        default_factory=left_out
    )  # (D, O + 1) association marginal, in an open world over pruned candidates, too; last: clutter, or a new object
    outlier_probability: Array = field(
        default_factory=left_out
    )  # (D,) that a detection is of no known object, or a geometric outlier of one; in an open world without an outlier
    # model NaN, as the detection may be of a new object
    noise_names: tuple[str, ...] = ()  # (N,) the inferred noise parameters, as the configuration names them
    noise_values: Array = field(default_factory=left_out)  # (N,)
    noise_sigmas: Array = field(default_factory=left_out)  # (N,)
    state_space: str = "planar"  # or "spatial"
    revised_ids: NDArray[np.uint64] = field(default_factory=lambda: np.zeros(0, dtype=np.uint64))  # (R,) hypotheses
    revised_keyframes: NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, dtype=np.uint32))  # (R,)
    revised_detections: NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, dtype=np.uint32))  # (R,) of it
    revised_objects: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, dtype=np.int32))  # (R,) id, or -1
    place_objects: NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, dtype=np.uint32))  # (M,) rows of
    # objects that are in one of several places; those on whose place the hypotheses agree have none
    place_probabilities: Array = field(default_factory=lambda: np.zeros(0))  # (M,) if it exists; sum to 1 per object
    place_means: Array = field(default_factory=lambda: np.zeros((0, 3)))  # (M, 3) in map
    place_covariances: Array = field(default_factory=lambda: np.zeros((0, 3, 3)))  # (M, 3, 3)

    @property
    def objects(self) -> tuple[ObjectEstimate, ...]:
        """(O,) marginal estimate of every object over all hypotheses."""
        return tuple(
            ObjectEstimate(
                object_id=int(self.object_ids[row]),
                name=name,
                existence=float(self.existence[row]),
                class_probabilities=dict(zip(self.class_names, self.class_probabilities[row].tolist(), strict=True)),
                pose=self.object_poses[row],
                covariance=self.object_covariances[row],
                places=self.places_of(row),
            )
            for row, name in enumerate(self.object_names)
        )

    @property
    def noise(self) -> dict[str, float]:
        """The inferred noise parameters by the names in the configuration."""
        return dict(zip(self.noise_names, self.noise_values.tolist(), strict=True))

    def places_of(self, row: int) -> tuple[ObjectPlace, ...]:
        """Where the object in a row of the arrays may be, likeliest first."""
        rows = np.flatnonzero(self.place_objects == row)
        rows = rows[np.argsort(-self.place_probabilities[rows], kind="stable")]
        if not len(rows):
            return (ObjectPlace(1.0, self.object_poses[row, :3], self.object_covariances[row, :3, :3]),)
        return tuple(
            ObjectPlace(float(self.place_probabilities[own]), self.place_means[own], self.place_covariances[own])
            for own in rows
        )

    @property
    def hypotheses(self) -> tuple[HypothesisEstimate, ...]:
        """(H,) the hypotheses, in descending order of weight."""
        object_ids = np.append(self.object_ids.astype(np.int64), -1)  # the last one is that of column -1
        return tuple(
            HypothesisEstimate(
                hypothesis_id=int(number),
                parent_id=int(self.parent_ids[row]),
                weight=float(np.exp(self.log_weights[row])),
                pose=self.poses[row],
                covariance=self.pose_covariances[row],
                associations=tuple(object_ids[self.associations[row]].tolist()),
            )
            for row, number in enumerate(self.hypothesis_ids)
        )

    def table(self) -> list[dict[str, object]]:
        """One row per object, in a form that ``pandas.DataFrame`` accepts."""
        return [known.row() for known in self.objects]

    def __post_init__(self) -> None:
        detections, objects = len(self.detection_ids), len(self.object_ids)
        shapes: dict[str, tuple[int, ...]] = {name: (objects, *_fixed(name)) for name in OPTIONAL}
        shapes |= {"association_probabilities": (detections, objects + 1), "outlier_probability": (detections,)}
        fill_left_out(self, shapes)


def _fixed(name: str) -> tuple[int, ...]:
    return tuple(size for size in QUANTITIES[name].shape if isinstance(size, int))
