"""Where on the map a lost robot may be: histories in which what it has mapped in a frame of its own is on the map.

Such a history begins at a start of its own, and names objects of the map in place of those that the robot had started;
it is replayed from there, and enters with the ratio of its P(history, Z_1:k) to that of the one it comes from. Nothing
is decided here: evidence decides between starts, and what is undecided stays so.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from semantic_slam.configuration import RevisionConfiguration
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.hypotheses import Hypothesis
from semantic_slam.inference.open_world.constellation import Fit, Fitting, Places, positions
from semantic_slam.inference.replay import Lineage, Replay
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.keys import object_key
from semantic_slam.inference.world.starts import Starts

LEAST_OBJECTS = 3
"""Objects from which on the robot may be placed by them."""
LEAST_EXISTENCE = 0.5
MARGIN = 5.0
"""Nats below what would enter that a fit is still replayed: it leaves misses out, and stretches of the drive."""


class Relocation:
    """Proposes and weighs histories in which a robot that is not placed is."""

    def __init__(self, settings: RevisionConfiguration, replay: Replay) -> None:
        self.settings, self._replay = settings, replay
        self._tried: dict[tuple[int, tuple[tuple[int, int], ...]], int] = {}

    @property
    def is_on(self) -> bool:
        """Whether the robot was lost when it began."""
        return self._replay.problem.starts is not None

    def is_due(self) -> bool:
        """Whether the newest keyframe is one after which to look."""
        every, count = self.settings.lost_every_keyframes, len(self._replay.steps)
        return self.is_on and 1 < count <= self.settings.horizon and count % every == 0

    def placed(self, live: Mapping[int, Hypothesis], ratio: float) -> dict[int, Hypothesis]:
        """New hypotheses that weigh at least the ``ratio``-th part of the best live one."""
        problem = self._replay.problem
        best = next(iter(live.values()))
        lost = next((own for own in live.values() if not problem.is_placed(own.lineage)), None)
        if lost is None:
            return {}
        (followed,) = self._replay.log_joints([lost.lineage])
        if followed is None:
            return {}
        least = best.log_weight - lost.log_weight - float(np.log(ratio))
        starts = {problem.start_of(problem.beginning(own.lineage)) for own in live.values()}
        lineages = self._proposals(lost.lineage, followed.component, least - MARGIN, starts)
        _, *others = self._replay.log_joints([lost.lineage, *lineages])
        return {
            own.number: Hypothesis(
                owner=lost.owner,
                log_weight=lost.log_weight + own.log_joint - followed.log_joint,
                parent_id=own.parent_id,
                lineage=own.lineage,
                revises=lost,
            )
            for own in others
            if own is not None and own.number not in live and own.log_joint - followed.log_joint >= least
        }

    def _proposals(self, lineage: Lineage, component: Component, least: float, taken: set[int]) -> list[Lineage]:
        """Histories at the starts that fit best, with a log gain of ``least``; starts already ``taken`` are kept to."""
        starts = self._replay.problem.starts
        assert starts is not None
        ids = self._own_objects(component)
        if len(ids) < LEAST_OBJECTS:
            return []
        fitting, found = self._fitting(component, ids, starts), list[Lineage]()
        now = len(self._replay.steps)
        for fit in fitting.best(4 * self.settings.proposals):
            start = starts.nearest(se2.compose(fit.T_map_own, starts.mean), taken)
            names = {ids[own]: self._map_ids[on_map] for own, on_map in fit.names.items()}
            what = (start or 0, tuple(sorted(names.items())))
            again = now - self._tried.get(what, -AGAIN) >= AGAIN
            if start is not None and fit.log_gain >= least and again and len(found) < self.settings.proposals:
                self._tried[what] = now
                found.append(self._renamed(lineage, start, names))
        return found

    def _own_objects(self, component: Component) -> list[int]:
        """Objects that the robot has started, and that are likely to exist."""
        known = component.objects
        likely = known.ids[known.existence > LEAST_EXISTENCE].tolist()
        return [n for n in likely if n not in component.elsewhere]

    @property
    def _map_ids(self) -> list[int]:
        return sorted(entry.object_id for entry in self._replay.problem.objects)

    def _fitting(self, component: Component, ids: Sequence[int], starts: Starts) -> Fitting:
        problem = self._replay.problem
        entries = sorted(problem.objects, key=lambda entry: entry.object_id)
        priors = [entry.prior for entry in entries]
        places = [positions(prior.mean[None], prior.covariance) for prior in priors]
        keys = [object_key(n) for n in ids]
        own: Places = positions(component.states(keys), component.joint_covariance(keys))
        settings = component.settings
        density = problem.open_world.birth_density if settings is None else settings.birth_density

        def log_prior(motions: Array) -> Array:
            return starts.log_density(se2.compose(motions, np.broadcast_to(starts.mean, motions.shape)))

        return Fitting(
            own=own,
            map_points=np.array([place.points[0] for place in places]),
            map_covariances=np.array([place.covariance for place in places]),
            log_new=np.full(len(ids), np.log(density)),
            log_prior=log_prior,
        )

    def _renamed(self, lineage: Lineage, start: int, names: Mapping[int, int]) -> Lineage:
        """The history from a start, with objects of the map in place of those that it had started."""
        problem = self._replay.problem
        steps = [
            replace(step, association=tuple(names.get(number, number) for number in step.association))
            for step in lineage
        ]
        steps[0] = replace(steps[0], mode=problem.with_start(problem.beginning(lineage), start))
        return tuple(steps)


AGAIN = 30
"""Keyframes after which a fit that was tried may be tried again."""
