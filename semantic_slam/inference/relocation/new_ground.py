"""Kidnapped to new ground: histories of a robot carried where nothing is known, followed beside the live ones.

They explain everything since without what was mapped before. That the robot did not simply drive on may show late: each
keyframe adds a little evidence, and pruning would have dropped such a history by then.
"""

from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.revision.replay import Progress, Replay
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.states.lineage import Lineage
from semantic_slam.inference.world.carried import NEW_GROUND

MOST = 3
"""Largest number of histories followed."""
HOPELESS = 12.0
"""Nats behind the best live hypothesis at which one is dropped."""
RATHER_EXISTS = 0.5


@dataclass(frozen=True)
class Followed:
    """One history on new ground."""

    since: int  # keyframe before which the robot was carried
    before: Progress  # up to there
    progress: Progress

    @property
    def log_joints(self) -> tuple[float, ...]:
        """log P(history, Z_1:i) after that keyframe, and after each since."""
        return self.progress.log_joints[self.since + 1 :]

    @property
    def num_recognisable(self) -> int:
        """Number of existing objects mapped since it was carried, or before, whichever is smaller."""
        known = self.progress.component.objects
        before = np.isin(known.ids, list(self.progress.component.left_behind))
        exists = known.existence > RATHER_EXISTS
        return int(min((exists & before).sum(), (exists & ~before).sum()))


class NewGround:
    """Follows the histories on new ground."""

    def __init__(self, replay: Replay) -> None:
        self._replay = replay
        self.followed: list[Followed] = []  # the likeliest first

    def begin(self, lineage: Lineage, since: int) -> Array | None:
        """Start the history that is ``lineage`` before a keyframe and on new ground from there on.

        Returns the pose (3,) before it, the origin of its frame; None where it is impossible.
        """
        before = self._replay.before(lineage, since)
        if before is None:
            return None
        try:
            progress = self._replay.carried(before, NEW_GROUND)
        except LostComponentError:
            return None
        self.followed.append(Followed(since, before, progress))
        return before.component.newest_robot()[:3]

    def go_on(self, log_best: float) -> None:
        """Advance to the newest keyframe; drop those far behind ``log_best``, log P(history, Z_1:k) of the best one."""
        found = [own for own in map(self._advanced, self.followed) if own is not None]
        found = [own for own in found if own.progress.log_joint > log_best - HOPELESS]
        self.followed = sorted(found, key=lambda own: (-own.progress.log_joint, own.since))[:MOST]

    def _advanced(self, own: Followed) -> Followed | None:
        while own.progress.at < len(self._replay.steps):
            try:
                progress = self._replay.advanced(own.progress, 1)
            except LostComponentError:
                return None
            own = replace(own, progress=progress)
        return own

    def before(self, since: int, lineage: Lineage) -> Progress | None:
        """The history ``lineage`` up to a keyframe, where one on new ground was begun from it; else None."""
        own = self.at(since)
        return own.before if own is not None and own.before.lineage[:since] == lineage[:since] else None

    def at(self, since: int) -> Followed | None:
        """The history on new ground from a keyframe on; None where there is none."""
        return next((own for own in self.followed if own.since == since), None)
