"""The mixture that a belief states, of the live hypotheses and the components that backends hold of them.

It differs from the engine's own: weights are averaged over resampled evidence, poses are in map although the robot is
lost, and objects exist as far as the detector's scores say so.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from semantic_slam.inference.alternatives.alternatives import Alternatives, NoAlternatives
from semantic_slam.inference.hypotheses import Hypothesis
from semantic_slam.inference.marginals import Mixture
from semantic_slam.inference.object_table import ObjectTable, stack_rows
from semantic_slam.inference.open_world.genuine_objects import GenuineObjects
from semantic_slam.inference.pruning import Kinds
from semantic_slam.inference.relocation.recovery import Recovery
from semantic_slam.inference.relocation.unplaced import in_map
from semantic_slam.inference.rounds import HeldComponent
from semantic_slam.inference.states.track_scores import existence_beside_rivals
from semantic_slam.inference.world.objects import ObjectRegistry, ReportedObjects
from semantic_slam.inference.world.problem import Problem


class Statement:
    """Makes the mixtures of one run."""

    def __init__(
        self,
        problem: Problem,
        registry: ObjectRegistry,
        genuine: GenuineObjects,
        recovery: Recovery,
        alternatives: Alternatives | NoAlternatives,
    ) -> None:
        self._problem, self._registry = problem, registry
        self._genuine, self._recovery, self._alternatives = genuine, recovery, alternatives

    def mixture(
        self, live: dict[int, Hypothesis], components: dict[int, HeldComponent], reported: ReportedObjects
    ) -> Mixture:
        """The mixture over the ``live`` hypotheses, in descending order of weight."""
        found = self._as_believed(live, components)
        rows = [self._in_map(components[n], hypothesis, reported) for n, hypothesis in found.items()]
        objects = stack_rows([held.objects for held in rows])
        objects = _beside_rivals(found, objects)
        objects = self._as_scored(found, reported.ids, objects)
        return Mixture(
            ids=list(found),
            parent_ids=[hypothesis.told_parent_id for hypothesis in found.values()],
            log_weights=np.array([hypothesis.log_weight for hypothesis in found.values()]),
            lineages=[hypothesis.lineage for hypothesis in found.values()],
            changes=self._alternatives.told({n: found[n] for n in live}),
            poses=np.array([held.pose for held in rows]),
            pose_covariances=np.array([held.covariance for held in rows]),
            objects=objects,
            noise=np.array([held.noise for held in rows]),
        )

    def _in_map(self, held: HeldComponent, hypothesis: Hypothesis, reported: ReportedObjects) -> HeldComponent:
        """Express a component in map, adding the frame's uncertainty where its robot is not localised in the map.

        A robot that is lost or was kidnapped maps in a local frame, whose pose in map is known only by its prior.
        """
        starts = self._problem.starts
        if hypothesis.grounds:
            frame, first = self._recovery.frame(hypothesis.grounds), self._registry.first_new_id(hypothesis.grounds[0])
            held = in_map(held, frame, np.array([n < first for n in reported.ids], dtype=bool))
        if starts is None or self._problem.is_placed(hypothesis.lineage):
            return held
        known = self._problem.map_ids
        return in_map(held, starts, np.array([n in known for n in reported.ids], dtype=bool))

    def _as_believed(self, live: dict[int, Hypothesis], components: dict[int, HeldComponent]) -> dict[int, Hypothesis]:
        """The live hypotheses by descending weight, their weights averaged over resampled evidence (``Bagging``).

        The resampling moderates the evidence between clusters of hypotheses whose robots are at different places;
        without it (``weights.bagged_sets`` or ``pruning.place_m`` is 0) the hypotheses are returned unchanged.
        """
        every, limits = list(live.items()), self._problem.pruning
        bagging = self._problem.bagging
        if bagging.num_replicates == 0 or limits.place_m <= 0.0:
            return live
        places = Kinds(
            positions=np.array([components[number].pose[:3] for number, _ in every]),
            root_numbers=np.zeros(len(every), dtype=int),
        )
        log_weights = bagging.log_weights(
            np.array([hypothesis.log_weight for _, hypothesis in every]),
            np.array([hypothesis.replicates for _, hypothesis in every]),
            places.of(np.arange(len(every)), limits.place_m),
        )
        return {
            every[row][0]: replace(every[row][1], log_weight=float(log_weights[row]))
            for row in np.argsort(-log_weights, kind="stable").tolist()
        }

    def _as_scored(self, live: dict[int, Hypothesis], ids: Sequence[int], objects: ObjectTable) -> ObjectTable:
        """(H, O) objects, their existence times the probability that they are genuine, by the detector's scores."""
        shares = self._genuine.shares(live, ids, np.minimum(objects.existed, 1.0))
        return objects if shares is None else objects.existing(shares)


def _beside_rivals(live: dict[int, Hypothesis], objects: ObjectTable) -> ObjectTable:
    """(H, O) objects, their existence beside the hypotheses in which they are false alarms, followed or not."""
    if not objects.track_scores.size:
        return objects
    weights = np.exp([hypothesis.log_weight for hypothesis in live.values()])
    return objects.existing(existence_beside_rivals(weights, objects.existed, objects.track_scores))
