"""Hindsight revision: association histories that look likelier in retrospect are replayed and become hypotheses.

Alternatives to a live history are: two of its objects are one; an object moves; the robot took one object for another
when it came back (a wrong loop closure); in space also: an object does not exist. The revised history and the one that
it comes from are both replayed from the prior, so the revised one enters with the ratio of their P(history, Z_1:k), as
if it had been followed all along; no optimisation precedes. It is replayed in the background, a few of its keyframes in
each new keyframe, and enters once it has caught up.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from semantic_slam.configuration import PruningConfiguration, RevisionConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.hypotheses import Hypothesis
from semantic_slam.inference.pruning import Kinds, ranks, shared_out
from semantic_slam.inference.revision.looking_back import Kind, LookingBack, Present
from semantic_slam.inference.revision.replay import Replay
from semantic_slam.inference.world.objects import ObjectRegistry
from semantic_slam.inference.world.problem import Problem


class Revision:
    """Looks for alternatives to the best history every few keyframes, until the drive exceeds a horizon."""

    def __init__(self, settings: RevisionConfiguration, replay: Replay, registry: ObjectRegistry) -> None:
        self._settings, self._replay = settings, replay
        self._looking_back = LookingBack(settings, replay, registry)

    @property
    def is_on(self) -> bool:
        """Whether any kind of revision is enabled."""
        return self._settings.is_on

    @property
    def is_over(self) -> bool:
        """Whether no history is replayed, nor will be: none is revised, or the drive exceeds the horizon."""
        return not self.is_on or len(self._replay.steps) > self._settings.horizon

    def go_on(self) -> None:
        """Replay, through the newest keyframe, as far as that needs no knowledge of the hypotheses after it.

        To be called while other processes weigh these. :meth:`revised` does what is left, in any case all.
        """
        if len(self._replay.steps) <= self._settings.horizon and not self._looking_back.is_idle:
            self._looking_back.go_on()

    def revised(self, present: Present) -> dict[int, Hypothesis]:
        """New hypotheses, by id, whose weight relative to the one that each revises is above the pruning ratio."""
        count = len(self._replay.steps)
        if count > self._settings.horizon:
            self._looking_back.give_up()
        elif self._looking_back.is_idle and (kinds := self._due(count)):
            self._looking_back.begin(present, kinds)
        return self._looking_back.found(present)

    def _due(self, count: int) -> set[Kind]:
        """Kinds of alternatives to look for after ``count`` keyframes."""
        every = {
            Kind.OTHERWISE: self._settings.every_keyframes,
            Kind.SECOND_BOXES: self._settings.second_boxes_every_keyframes,
        }
        return {kind for kind, apart in every.items() if apart > 0 and count % apart == 0}


def with_revised(
    live: Mapping[int, Hypothesis],
    found: Mapping[int, Hypothesis],
    places: Mapping[int, Array],
    problem: Problem,
    limits: PruningConfiguration,
    most: int | None = None,
) -> dict[int, Hypothesis]:
    """Live and revised hypotheses, heaviest first, as many as pruning keeps; weights in the unit of the live ones.

    A revised hypothesis displaces a near variant, and none that pruning keeps for its diversity (another place or
    start). ``places``: positions (3,) [m] of the robot in the live hypotheses. ``most``: kept of a kind; None: any
    number.
    """
    every = sorted({**live, **found}.items(), key=lambda item: (-item[1].log_weight, item[0]))
    if limits.place_m <= 0.0:
        return dict(every[: limits.max_hypotheses])
    rows = [places[number] if number in live else _place(hypothesis, problem) for number, hypothesis in every]
    kinds = Kinds(
        positions=np.array(rows),
        root_numbers=np.array([problem.root_number(hypothesis.lineage) for _, hypothesis in every]),
    ).of(np.arange(len(every)), limits.place_m)
    if most is not None:
        left = np.flatnonzero(ranks(kinds) < most)
        every, kinds = [every[row] for row in left], kinds[left]
    return dict([every[row] for row in shared_out(kinds, limits.max_hypotheses)])


def _place(hypothesis: Hypothesis, problem: Problem) -> Array:
    """(3,) position [m] of the robot in a replayed history."""
    assert hypothesis.replayed is not None
    return np.asarray(problem.spaces.robot.poses(hypothesis.replayed.newest_robot()[None])[0, :3])


def normalised(hypotheses: Mapping[int, Hypothesis]) -> tuple[dict[int, Hypothesis], float]:
    """Hypotheses with weights that sum to one, and the log of the sum before."""
    weights: Array = np.array([hypothesis.log_weight for hypothesis in hypotheses.values()])
    total = float(np.logaddexp.reduce(weights))
    return {
        n: replace(hypothesis, log_weight=hypothesis.log_weight - total) for n, hypothesis in hypotheses.items()
    }, total
