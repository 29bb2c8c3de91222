"""Association by identities that come with the detections."""

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
    """Each detection names its object; a new name is a new object, and a detection without a name is clutter.

    So is one whose name is wrong, which each may be.
    """

    needs_map, wants_identities = False, True

    @staticmethod
    def introduce(registry: ObjectRegistry, step: Step) -> None:
        """The objects that are named for the first time."""
        for name in step.names:
            registry.identify(name)

    def predict(self, step: Step, parents: Parents, path: LineageStep | None) -> ClosedKeyframe:
        """About the objects that the keyframe names; along a ``path`` through many of them, those of that path."""
        identities = [self.registry.identify(name) for name in step.names]
        used = np.array([i for i, number in enumerate(identities) if number >= 0], dtype=int)
        named = sorted({identities[i] for i in used})
        known = [n for n in named if n in parents.components[0].object_ids]
        known = expected_along(path, known)
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
        """(n,) log odds that an identity is wrong, times the density of its detection if it is.

        The first detection of an object is taken at its word: it is all that tells where the object is.
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
        """Broad priors about where this hypothesis first sees the objects that it does not know."""
        if not unknown:
            return {}
        robot = self.problem.spaces.robot.compose(component.newest_robot(), step.motion.control)
        first = {n: next(step.detections[i] for i in used if identities[i] == n) for n in unknown}
        return {n: self.problem.model.object_prior(detection, robot) for n, detection in first.items()}


def log_odds_of_wrong_identity(problem: Problem) -> float:
    """Log odds that an identity is wrong; -inf where none is, or where nothing says what its detection looks like."""
    share = problem.closed_world.wrong_identity_share
    if problem.clutter is None or share <= 0.0:
        return -np.inf
    return float(np.log(share) - np.log1p(-share))
