"""Loop-closure alternatives: histories in which a return was to another object, with a memory of those tried."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.configuration import RevisionConfiguration
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.revision.replay import Replay, Revised
from semantic_slam.inference.revision.returns.first_and_missed import FirstAndMissed
from semantic_slam.inference.revision.returns.runs import Parting, Runs
from semantic_slam.inference.revision.returns.splits import Splits
from semantic_slam.inference.revision.returns.whole_drive import WholeDrive
from semantic_slam.inference.revision.tried import Group, Tried
from semantic_slam.inference.states.keys import robot_key
from semantic_slam.inference.states.lineage import MOVES, Lineage
from semantic_slam.inference.world.objects import ObjectRegistry

ROUGHLY = 6.0
"""Error [nats] allowed in the rough weights of histories."""
MOST_REPLAYED = 2
"""Most histories that one look replays."""
MOST_DETECTIONS = 800
"""Number of detections beyond which a drive is not solved in one piece, at cubic cost."""


class Returns:
    """Proposes histories in which a return (loop closure) was to another object."""

    def __init__(self, settings: RevisionConfiguration, replay: Replay, registry: ObjectRegistry, patience: int):
        """``patience``: keyframes after which a return that was tried may be tried again."""
        self._settings, self._replay, self._registry = settings, replay, registry
        self._tried = Tried(patience)

    def histories(self, followed: Revised, ratio: float) -> list[Lineage]:
        """Histories that may weigh at least 1 / ``ratio`` of the one ``followed``, likeliest first.

        After these their beginnings, up to the return: later detections may have been assigned otherwise, had the robot
        been known to be elsewhere.
        """
        if self._settings.splits == 0:
            return []
        view = _View.of(self._replay, self._registry, followed)
        if not 0 < len(view.drive.keyframes) <= MOST_DETECTIONS:
            return []
        splits = Splits(drive=view.drive, runs=view.runs, record=view.record, path=view.path)

        def is_news(parting: Parting) -> bool:
            return bool(self._tried.news([view.group(parting)], followed.lineage))

        try:
            found = splits.best(self._settings.splits, is_news)
        except np.linalg.LinAlgError:
            return []
        least = -float(np.log(ratio)) - ROUGHLY
        self._note([view.group(parting) for parting, _, gain in found if gain < least])
        likely = sorted((own for own in found if own[2] >= least), key=lambda own: -own[2])[:MOST_REPLAYED]
        self._note([view.group(parting) for parting, _, _ in likely])
        named = [(parting, view.renamed(objects)) for parting, objects, _ in likely]
        return [history for _, history in named] + [
            history[: view.returns_at(parting) + 1] for parting, history in named
        ]

    def _note(self, groups: Sequence[Group]) -> None:
        """Record the returns tried now."""
        self._tried.note(groups, len(self._replay.steps))


@dataclass(frozen=True)
class _View:
    """A history as a whole-drive problem, its objects being unions of runs."""

    lineage: Lineage
    drive: WholeDrive
    runs: Runs
    record: FirstAndMissed
    path: Array  # (1 + T, 3)
    ids: Index  # (n,) objects of the detections
    born: Index  # (n,) ids of the objects that they would start
    map_ids: list[int]

    @classmethod
    def of(cls, replay: Replay, registry: ObjectRegistry, followed: Revised) -> "_View":
        problem, steps, component, lineage = replay.problem, replay.steps, followed.component, followed.lineage
        drive = WholeDrive.of(problem, component, steps, _standing(lineage))
        rows = list(zip(drive.keyframes.tolist(), drive.numbers.tolist(), strict=True))
        ids = np.array([lineage[k].association[n] for k, n in rows], dtype=int)
        born = np.array([registry.first_new_id(k) + n for k, n in rows], dtype=int)
        map_ids = sorted(problem.map_ids - component.elsewhere)
        others = sorted(set(ids.tolist()) - set(map_ids))
        number = {n: place for place, n in enumerate([*map_ids, *others])}
        objects = np.array([number[n] for n in ids.tolist()], dtype=int)
        births, mapped = followed.expected_births, len(map_ids)
        return cls(
            lineage=lineage,
            drive=drive,
            runs=Runs.of(objects, drive.keyframes, mapped, len(steps)),
            record=FirstAndMissed.of(problem.open_world, steps, component, births, mapped),
            path=component.states([robot_key(k) for k in range(-1, len(steps))])[:, :3],
            ids=ids,
            born=born,
            map_ids=map_ids,
        )

    def returns_at(self, parting: Parting) -> int:
        """The keyframe of the return."""
        return int(self.runs.keyframes[parting.returned])

    def group(self, parting: Parting) -> Group:
        """Identity of a parting: the object, the new object, and how much of it is split off."""
        rows = np.flatnonzero(self.runs.detections == parting.returned)
        size = int((parting.objects[self.runs.detections] == parting.parted[1]).sum())
        until_next = -1 if size == len(rows) else -2
        return int(self.ids[rows[0]]), int(self.born[rows[0]]), until_next

    def renamed(self, objects: Index) -> Lineage:
        """The history in which the detections are of ``objects`` (n,), those of the map first."""
        names = self.ids.copy()
        for number in np.unique(objects).tolist():
            rows = np.flatnonzero(objects == number)
            names[rows] = self._name(int(rows[0])) if number >= len(self.map_ids) else self.map_ids[number]
        association = [list(step.association) for step in self.lineage]
        for k, n, name in zip(self.drive.keyframes, self.drive.numbers, names.tolist(), strict=True):
            association[k][n] = name
        return tuple(replace(step, association=tuple(own)) for step, own in zip(self.lineage, association, strict=True))

    def _name(self, first: int) -> int:
        """Id of an object first seen in this detection: the id it has in the history from there on, or a new one."""
        own = int(self.ids[first])
        begins = own not in self.map_ids and first == int(np.flatnonzero(self.ids == own)[0])
        return own if begins else int(self.born[first])


def _standing(lineage: Lineage) -> list[Flags]:
    """For each keyframe (D,) whether detections are of objects taken to stand still."""
    pairs = [pair for step in lineage for pair in zip(step.association, step.class_assignment, strict=True)]
    moving = {number for number, kind in pairs if kind == MOVES}
    return [np.array([number >= 0 and number not in moving for number in step.association]) for step in lineage]
