"""Association by given identities: detections carry the track id of their object."""

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.association.closed_keyframe import ClosedKeyframe
from semantic_slam.inference.association.closed_world import ClosedWorld, expected_along
from semantic_slam.inference.association.strategy import Parents
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.lineage import LineageStep
from semantic_slam.inference.world.objects import ObjectRegistry
from semantic_slam.inference.world.problem import Problem


class GivenAssociation(ClosedWorld):
    """Strategy ``given``: each detection names its object; a new name is a new object, no name means clutter.

    Each identity may be wrong, with a small probability; the detection then counts as clutter. What was moved since the
    map was made is the named object's displaced twin.
    """

    needs_map, wants_identities = False, True

    @staticmethod
    def introduce(registry: ObjectRegistry, step: Step) -> None:
        """Register the objects that are named for the first time."""
        for name in step.names:
            registry.identify(name)

    def predict(self, step: Step, parents: Parents, path: LineageStep | None) -> ClosedKeyframe:
        """The keyframe as predicted for the parents, with the objects that it names; with a ``path``, only its own."""
        identities = [self.registry.identify(name) for name in step.names]
        used = np.array([i for i, number in enumerate(identities) if number >= 0], dtype=int)
        named = sorted({identities[i] for i in used})
        known = [n for n in named if n in parents.components[0].object_ids]
        elsewhere = self.problem.displaced.elsewhere
        known = expected_along(path, [*known, *(elsewhere[n] for n in known if n in elsewhere)])
        unknown = [n for n in named if n not in parents.components[0].object_ids]
        return ClosedKeyframe(
            problem=self.problem,
            registry=self.registry,
            step=step,
            parents=parents,
            path=path,
            used=used,
            known=known,
            identities=[identities[i] for i in used],
            log_clutter=self._log_clutter(step, used, identities, unknown),
            new=[self._priors(component, step, used, identities, unknown) for component in parents.components],
        )

    def _log_clutter(self, step: Step, used: Index, identities: list[int], unknown: list[int]) -> Array | None:
        """(n,) log of the odds that an identity is wrong, times the clutter density of its detection; None: none is.

        The first detection of an object is always trusted (-inf), as nothing else tells where the object is.
        """
        odds, clutter = log_odds_of_wrong_identity(self.problem), self.problem.clutter
        if clutter is None or odds == -np.inf:
            return None
        log_odds = np.asarray(odds + clutter.log_place([step.detections[i] for i in used]))
        named = [identities[i] for i in used]
        log_odds[[named.index(n) for n in unknown]] = -np.inf
        return log_odds

    def _priors(
        self, component: Component, step: Step, used: Index, identities: list[int], unknown: list[int]
    ) -> dict[int, GaussianPrior]:
        """Broad priors of newly named objects, about where their first detections put them in this hypothesis."""
        if not unknown:
            return {}
        robot = self.problem.spaces.robot.compose(component.newest_robot(), step.motion.control)
        first = {n: next(step.detections[i] for i in used if identities[i] == n) for n in unknown}
        return {n: self.problem.model.object_prior(detection, robot) for n, detection in first.items()}


def log_odds_of_wrong_identity(problem: Problem) -> float:
    """Log odds that an identity is wrong; -inf if none ever is, or without a clutter model."""
    share = problem.closed_world.wrong_identity_share
    if problem.clutter is None or share <= 0.0:
        return -np.inf
    return float(np.log(share) - np.log1p(-share))
