"""Where on the map a lost robot may be: histories in which what it has mapped in a frame of its own is on the map.

Such a history begins at a start of its own, and names objects of the map in place of those that the robot had started;
it is replayed from there, and enters with the ratio of its P(history, Z_1:k) to that of the one it comes from. Nothing
is decided here: evidence decides between starts, and what is undecided stays so.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.configuration import RevisionConfiguration
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.hypotheses import Hypothesis
from semantic_slam.inference.open_world.constellation import Fitting, Places, positions
from semantic_slam.inference.replay import Lineage, Replay
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.states.keys import object_key
from semantic_slam.inference.world.starts import Starts

LEAST_OBJECTS = 3
"""Objects from which on the robot may be placed by them."""
LEAST_EXISTENCE = 0.5
AGAIN = 30
"""Keyframes after which a fit that was tried may be tried again."""
SELDOM = 4
"""How many times as many keyframes there are between looks where all histories are placed."""
MARGIN = 5.0
"""Nats below what would enter that a fit is still replayed: it leaves misses out, and stretches of the drive."""


@dataclass(frozen=True)
class _Lost:
    """A history that does not place the robot."""

    lineage: Lineage
    surplus: float  # log of its weight, with that of near copies, to its own


class Relocation:
    """Proposes and weighs histories in which a robot that is not placed is."""

    def __init__(self, settings: RevisionConfiguration, replay: Replay) -> None:
        self.settings, self._replay = settings, replay
        self._tried: dict[tuple[int, tuple[tuple[int, int], ...]], int] = {}
        self._lost: _Lost | None = None

    @property
    def is_on(self) -> bool:
        """Whether the robot was lost when it began."""
        return self._replay.problem.starts is not None

    def is_due(self, live: Mapping[int, Hypothesis]) -> bool:
        """Whether the newest keyframe is one after which to look: more seldom where all histories are placed."""
        count, every = len(self._replay.steps), self.settings.lost_every_keyframes
        if not self.is_on or not 1 < count <= self.settings.horizon:
            return False
        return count % (every if self._likeliest_lost(live) else SELDOM * every) == 0

    def placed(self, live: Mapping[int, Hypothesis], log_evidence: float, ratio: float) -> dict[int, Hypothesis]:
        """New hypotheses that weigh at least the ``ratio``-th part of the best live one.

        ``log_evidence``: what weights are relative to. They come from the likeliest history that is not placed; when
        evidence has done away with all of these, its likeliest continuation is still followed, so that a robot that was
        placed wrongly is found.
        """
        problem, best = self._replay.problem, next(iter(live.values()))
        lost = self._likeliest_lost(live)
        lineage = self._continued() if lost is None else lost.lineage
        if lineage is None:
            return {}
        (followed,) = self._replay.log_joints([lineage])
        if followed is None:
            return {}
        if lost is not None:  # it may stand for near copies: what comes from it stands for as many
            surplus = lost.log_weight + log_evidence - followed.log_joint
        else:
            surplus = self._lost.surplus if self._lost is not None else 0.0
        self._lost = _Lost(lineage, surplus)
        unit = log_evidence - surplus
        least = best.log_weight + unit - float(np.log(ratio))
        starts = {problem.start_of(problem.beginning(own.lineage)) for own in live.values()}
        gain = least - followed.log_joint - MARGIN
        lineages = self._proposals(lineage, followed.component, gain, starts)
        _, *others = self._replay.log_joints([lineage, *lineages])
        return {
            own.number: Hypothesis(
                owner=best.owner,
                log_weight=own.log_joint - unit,
                parent_id=own.parent_id,
                lineage=own.lineage,
                revises=lost or best,
            )
            for own in others
            if own is not None and own.number not in live and own.log_joint >= least
        }

    def _likeliest_lost(self, live: Mapping[int, Hypothesis]) -> Hypothesis | None:
        """The live hypothesis that weighs most of those that do not place the robot."""
        is_placed = self._replay.problem.is_placed
        return next((own for own in live.values() if not is_placed(own.lineage)), None)

    def _continued(self) -> Lineage | None:
        """The history that was not placed when there was one, up to now."""
        try:
            return None if self._lost is None else self._replay.continued(self._lost.lineage)
        except LostComponentError:
            return None

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
