"""Continuations of an open world's hypotheses, and what a component needs to know of one."""

from dataclasses import dataclass, field

from semantic_slam.inference.component import Observed
from semantic_slam.inference.continuation import Continuations
from semantic_slam.inference.gating import Pairs
from semantic_slam.inference.gaussian import GaussianPrior
from semantic_slam.inference.object_views import ObjectViews
from semantic_slam.inference.open_component import Grown
from semantic_slam.inference.outlook import Outlook
from semantic_slam.inference.population import Account
from semantic_slam.inference.step import Step


@dataclass(frozen=True)
class OpenContinuations(Continuations):
    """Besides: what each continuation makes of the objects' existence."""

    accounts: list[Account] = field(default_factory=list)  # K
    outlooks: list[Outlook] = field(default_factory=list)  # P
    pairs: list[Pairs] = field(default_factory=list)  # P

    def added(self, step: Step, at: int, views: dict[int, ObjectViews], *, settle: bool) -> Grown:
        """What one continuation adds to its parent.

        ``views``: records of the objects seen. With a local map where updates do not ``settle``.
        """
        taken, account = self.steps[at], self.accounts[at]
        pairs = zip(step.detections, taken.association, taken.class_assignment, strict=True)
        modes = dict(zip(taken.association, self.objects[at], strict=True))
        parent = self.parents[at]
        outlook, births = self.outlooks[parent], self.new_objects[parent]
        return Grown(
            [Observed(detection, number, cls) for detection, number, cls in pairs],
            list(self.objects[at]),
            self.robot[at],
            outlook.predicted.mean[0, 0],
            {int(n): GaussianPrior(modes[int(n)], births[int(n)].covariance) for n in account.new_ids},
            views,
            self.robot_corrections[at],
            account,
            None if settle else outlook.local_after(self.pairs[parent], taken.association, births),
        )
