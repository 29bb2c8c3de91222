"""Association revised afterwards: histories in which two objects of a live one are the same, in which one moves, or in
which the robot took one object for another when it came back; in space those in which an object is none.

A revised history is replayed from the prior, and so is the one that it comes from: it enters with the ratio of their
P(history, Z_1:k), as if it had been followed all along. Nothing is optimised under it before. It is replayed beside the
keyframes, a few keyframes of its own in each, and enters once it has caught up.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from semantic_slam.configuration import RevisionConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.hypotheses import Hypothesis
from semantic_slam.inference.pruning import Kinds, shared_out
from semantic_slam.inference.revision.looking_back import Kind, LookingBack, Present
from semantic_slam.inference.revision.replay import Replay
from semantic_slam.inference.world.objects import ObjectRegistry
from semantic_slam.inference.world.problem import Problem


class Revision:
    """Looks back from the best history every few keyframes, up to a horizon."""

    def __init__(self, settings: RevisionConfiguration, replay: Replay, registry: ObjectRegistry) -> None:
        self._settings, self._replay = settings, replay
        self._looking_back = LookingBack(settings, replay, registry)

    @property
    def is_on(self) -> bool:
        """Whether anything is ever revised."""
        return self._settings.is_on

    def revised(self, present: Present) -> dict[int, Hypothesis]:
        """New hypotheses that weigh as much as pruning asks beside the one that each revises."""
        count = len(self._replay.steps)
        if count > self._settings.horizon:
            self._looking_back.give_up()
        elif self._looking_back.is_idle and (kinds := self._due(count)):
            self._looking_back.begin(present, kinds)
        return self._looking_back.found(present)

    def _due(self, count: int) -> set[Kind]:
        """What to look for after so many keyframes."""
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
) -> dict[int, Hypothesis]:
    """Live and revised hypotheses, heaviest first, as many as pruning keeps; weights in the live ones' unit.

    What goes for them is a variant, not what pruning keeps for being of another kind. ``places`` (3,) of the live ones'
    robots [m].
    """
    limits = problem.pruning
    every = sorted({**live, **found}.items(), key=lambda item: (-item[1].log_weight, item[0]))
    if limits.place_m <= 0.0:
        return dict(every[: limits.max_hypotheses])
    rows = [places[number] if number in live else _place(own, problem) for number, own in every]
    kinds = Kinds(
        positions=np.array(rows),
        beginnings=np.array([problem.beginning(own.lineage) for _, own in every]),
    ).of(np.arange(len(every)), limits.place_m)
    return dict([every[row] for row in shared_out(kinds, limits.max_hypotheses)])


def _place(own: Hypothesis, problem: Problem) -> Array:
    """(3,) position [m] of the robot in a history that was replayed."""
    assert own.replayed is not None
    return np.asarray(problem.spaces.robot.poses(own.replayed.newest_robot()[None])[0, :3])


def normalised(hypotheses: Mapping[int, Hypothesis]) -> tuple[dict[int, Hypothesis], float]:
    """Hypotheses with weights that sum to one, and the log of what they summed to."""
    weights: Array = np.array([own.log_weight for own in hypotheses.values()])
    total = float(np.logaddexp.reduce(weights))
    return {n: replace(own, log_weight=own.log_weight - total) for n, own in hypotheses.items()}, total
