"""Histories in which the robot was set down on new ground, followed beside the live ones until they weigh as much.

What was seen since has one explanation that needs nothing of what was mapped before. That the robot has not gone on may
show late: each keyframe tells a little, and pruning would have forgotten that history by then.
"""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.revision.replay import Lineage, Progress, Replay
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.world.carried import NEW_GROUND

MOST = 6
"""Histories that are followed at most."""
HOPELESS = 20.0
"""Nats behind the best live hypothesis from which on one is given up."""
RATHER_EXISTS = 0.5


@dataclass(frozen=True)
class Followed:
    """One of these histories."""

    since: int  # keyframe before which the robot was carried
    progress: Progress
    log_joints: tuple[float, ...]  # after that keyframe, and after each since

    @property
    def num_recognisable(self) -> int:
        """What it holds to exist of objects that it has mapped since, or of those before, where these are fewer."""
        known = self.progress.component.objects
        before = np.isin(known.ids, list(self.progress.component.left_behind))
        exists = known.existence > RATHER_EXISTS
        return int(min((exists & before).sum(), (exists & ~before).sum()))


class NewGround:
    """Follows them."""

    def __init__(self, replay: Replay) -> None:
        self._replay = replay
        self.followed: list[Followed] = []  # the likeliest first

    def begin(self, lineage: Lineage, since: int) -> Array | None:
        """Follow the history that is ``lineage`` before a keyframe, and on new ground from there on.

        Returns the pose (3,) before it, at which its frame begins.
        """
        before = self._replay.before(lineage, since)
        if before is None:
            return None
        try:
            progress = self._replay.carried(before, NEW_GROUND)
        except LostComponentError:
            return None
        self.followed.append(Followed(since, progress, (progress.log_joint,)))
        return before.component.newest_robot()[:3]

    def go_on(self, log_best: float) -> None:
        """Through all keyframes so far; those are given up that are far behind ``log_best``, log P(history, Z_1:k)."""
        found = [own for own in map(self._advanced, self.followed) if own is not None]
        found = [own for own in found if own.progress.log_joint > log_best - HOPELESS]
        self.followed = sorted(found, key=lambda own: (-own.progress.log_joint, own.since))[:MOST]

    def _advanced(self, own: Followed) -> Followed | None:
        while own.progress.at < len(self._replay.steps):
            try:
                progress = self._replay.advanced(own.progress, 1)
            except LostComponentError:
                return None
            own = Followed(own.since, progress, (*own.log_joints, progress.log_joint))
        return own

    def at(self, since: int) -> Followed | None:
        """The history that is followed from a keyframe on."""
        return next((own for own in self.followed if own.since == since), None)
