"""Continuations of an open world's hypotheses, and what a component needs to know of one."""

from dataclasses import dataclass, field

from semantic_slam.inference.association.gating import PairDensities
from semantic_slam.inference.expander import Continuations
from semantic_slam.inference.models.step import AssociatedDetection, Step
from semantic_slam.inference.open_world.prediction import Prediction
from semantic_slam.inference.smoothing.open_component import OpenUpdate
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.object_table import ExistenceUpdate
from semantic_slam.inference.states.object_views import ObjectViews


@dataclass(frozen=True)
class OpenContinuations(Continuations):
    """Besides: what each continuation makes of the objects' existence."""

    accounts: list[ExistenceUpdate] = field(default_factory=list)  # K
    predictions: list[Prediction] = field(default_factory=list)  # P
    pairs: list[PairDensities] = field(default_factory=list)  # P

    def added(self, step: Step, at: int, views: dict[int, ObjectViews], *, settle: bool) -> OpenUpdate:
        """What one continuation adds to its parent.

        ``views``: records of the objects seen. With a local map where updates do not ``settle``.
        """
        taken, account = self.steps[at], self.accounts[at]
        pairs = zip(step.detections, taken.association, taken.class_assignment, strict=True)
        modes = dict(zip(taken.association, self.objects[at], strict=True))
        parent = self.parents[at]
        prediction, births = self.predictions[parent], self.new_objects[parent]
        return OpenUpdate(
            [AssociatedDetection(detection, number, cls) for detection, number, cls in pairs],
            list(self.objects[at]),
            self.robot[at],
            prediction.predicted.mean[0, 0],
            {int(n): GaussianPrior(modes[int(n)], births[int(n)].covariance) for n in account.new_ids},
            views,
            self.robot_corrections[at],
            account,
            None if settle else prediction.local_after(self.pairs[parent], taken.association, births),
        )
