"""Known data association: detections carry identities; states are tracked as in an open world.

Odometry biases, correlated errors and a learned sensor region are estimated as there; the object of a detection is the
one it names, up to a share of wrong names.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.association.gating import PairDensities, RankedAssignments
from semantic_slam.inference.association.given import GivenAssociation, log_odds_of_wrong_identity
from semantic_slam.inference.association.strategy import Parents
from semantic_slam.inference.models.clutter import EvenClutter
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.open_world.joint.linear_evidence import LinearisedEvidence
from semantic_slam.inference.open_world.keyframe.open_association import OpenAssociation
from semantic_slam.inference.open_world.named.keyframe import NamedKeyframe
from semantic_slam.inference.open_world.named.wrong_names import right_names
from semantic_slam.inference.open_world.planar.region import SensorRegion
from semantic_slam.inference.open_world.prediction.prediction import Prediction
from semantic_slam.inference.open_world.prediction.predictor import FrameInput
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.states.lineage import LineageStep


class NamedAssociation(OpenAssociation):
    """Each detection names its object; a new name is a new object, and a detection without a name is clutter.

    A detection with a wrong name is clutter too; any name may be wrong, except the first of each object. Objects exist
    for sure.
    """

    wants_identities, counts_misses, merges_copies = True, False, False

    @classmethod
    def suited_to(cls, configuration: Configuration) -> type[Any]:
        """The closed-world association where updates are iterated, else this class."""
        return GivenAssociation if configuration.open_world.iterate_updates else cls

    introduce = staticmethod(GivenAssociation.introduce)
    reported = staticmethod(GivenAssociation.reported)

    def predict(self, step: Step, parents: Parents, path: LineageStep | None) -> NamedKeyframe:
        """Each parent's prediction, for the objects that the keyframe names."""
        told = np.array([self.registry.identify(name) for name in step.names], dtype=int)
        used = self._used(told)
        identities, detections = told[used], [step.detections[number] for number in used]
        known = np.isin(identities, list(parents.components[0].object_ids))
        named, first = np.unique(identities[known]), _first_of(identities, np.flatnonzero(~known))
        predictions = [
            self.predictor.predict(
                component,
                FrameInput(motion=step.motion, detections=component.sensed(detections), sensed=step.sensed),
                named=component.objects.rows(named),
            )
            for component in parents.components
        ]
        pairs = self.pairs_of(predictions)
        log_wrong = np.array([self._log_wrong(own.region, own.detections) for own in predictions])
        columns = np.where(known, np.searchsorted(named, identities), -1)
        columns[first] = len(named) + first
        if path is None:
            every = zip(predictions, pairs, log_wrong, strict=True)
            ranked = [self._likely(prediction, own, columns, wrong) for prediction, own, wrong in every]
        else:
            ranked = [RankedAssignments(_along(path, used, identities, columns), np.zeros(1), -np.inf)]
        return NamedKeyframe(
            problem=self.problem,
            registry=self.registry,
            step=step,
            parents=parents,
            path=path,
            predictions=predictions,
            pairs=pairs,
            ranked=ranked,
            named=used,
            identities=identities,
            first=first,
            log_wrong=log_wrong,
        )

    def _used(self, told: Index) -> Index:
        """The detections that carry a name; where names cannot be wrong, only the first of each object."""
        used = np.flatnonzero(told >= 0)
        if np.isfinite(log_odds_of_wrong_identity(self.problem)):
            return used
        return used[_first_of(told[used], np.arange(len(used)))]

    def _log_wrong(self, region: SensorRegion, detections: Sequence[Any]) -> Array:
        """(n,) log odds that a name is wrong, times the density of its detection as uniform clutter."""
        clutter = EvenClutter(region.area_m2, region.field_of_view_rad)
        return log_odds_of_wrong_identity(self.problem) + clutter.log_place(detections)

    def _likely(
        self, prediction: Prediction, pairs: PairDensities, columns: Index, log_wrong: Array
    ) -> RankedAssignments:
        """The likeliest choices of wrong names; ``columns`` (n,) of the objects as named, -1: it is wrong for sure."""
        doubtful = np.flatnonzero((columns >= 0) & (columns < len(prediction.near))).tolist()
        if not doubtful:
            return RankedAssignments(columns.reshape(1, -1), np.zeros(1), -np.inf)
        linear = LinearisedEvidence.of(self.problem.spaces, prediction, pairs)
        joint = linear.innovation(columns, doubtful)
        weights = self.problem.open_weights
        told = columns[doubtful], log_wrong[doubtful]
        found = right_names(joint, *told, weights.max_candidates, weights.gate, linear.tail)
        chosen = np.tile(columns, (len(found.right), 1))
        chosen[:, doubtful] = np.where(found.right, columns[doubtful], -1)
        return RankedAssignments(chosen, found.log_scores, found.log_left_out)


def _first_of(identities: Index, among: Index) -> Index:
    """Which of ``among`` are the first detections of their objects."""
    _, first = np.unique(identities[among], return_index=True)
    return np.sort(among[first])


def _along(path: LineageStep, used: Index, identities: Index, columns: Index) -> Index:
    """(1, n) columns of a lineage's association. Raises LostComponentError."""
    taken = np.array([path.association[number] for number in used], dtype=int)
    right = taken == identities
    if (~right & (taken >= 0)).any() or (right & (columns < 0)).any():
        raise LostComponentError("a lineage names an object that its detections do not")
    return np.where(right, columns, -1).reshape(1, -1)
