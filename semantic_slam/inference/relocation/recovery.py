"""Kidnapped-robot recovery: histories in which the robot was carried just before a keyframe not expected by the belief.

Where a keyframe was likelier under the null model (the reference) than under the belief, the robot may have been
carried just before it. Where objects come and go, a history on new ground is followed from there. Whether the robot may
have been set down on known ground is told by a vote of all later detections, and the likeliest poses are replayed. All
of these enter with P(history, Z_1:k), as those of a lost robot do, once they weigh enough.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from semantic_slam.configuration import RevisionConfiguration
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import planar_from_pose_vector
from semantic_slam.inference.hypotheses import Hypothesis
from semantic_slam.inference.relocation.likely_poses import likely_poses, num_seen
from semantic_slam.inference.relocation.new_ground import NewGround
from semantic_slam.inference.relocation.places import Account, Places, account
from semantic_slam.inference.revision.replay import CHECKPOINT, Progress, Revised
from semantic_slam.inference.revision.storable_replay import StorableReplay, StoredReplay
from semantic_slam.inference.states.lineage import Lineage
from semantic_slam.inference.world.carried import is_carried_lately, new_grounds
from semantic_slam.inference.world.objects import ObjectRegistry
from semantic_slam.inference.world.starts import Starts

LOOKS = (3, 6, 10, 15, 20, 27, 35)
"""Keyframes after an unexpected one at which to search for poses on known ground."""
MARGIN = 1.0
"""Nats below the entry threshold at which a history is weighed exactly: the best one's own weight is known roughly."""
PROMISING = 1.0
"""Nats behind the best live hypothesis up to which a history on new ground is looked at."""
LEAST_OBJECTS = 2
"""Number of recognisable objects from which on a robot on new ground may be localised by them."""


@dataclass
class _Suspect:
    """A keyframe before which the robot may have been carried."""

    log_ratio: float  # reference to belief, summed over a run of unexpected keyframes
    looks: int = 0  # number of the ``LOOKS`` that are done
    looked: int = 0  # keyframe of the last look, or of the last history that entered
    num_seen: int = 0  # detections since the suspect, at the last look


class Recovery:
    """Proposes and weighs histories in which the robot was carried (kidnapped)."""

    STATE: ClassVar[tuple[str, ...]] = (
        "_num_noted",
        "_num_expected",
        "_misfit",
        "_suspects",
        "_begun",
        "_log_surplus",
        "_origins",
        "_checkpoints",
        "_places",
    )

    def __init__(self, settings: RevisionConfiguration, replay: StorableReplay, registry: ObjectRegistry) -> None:
        self._horizon, self._replay, self._registry = settings.horizon, replay, registry
        self._new_ground = NewGround(replay) if replay.association.tracks_objects else None
        self._places = Places(replay)
        self._num_noted = 0  # keyframes
        self._num_expected = 0  # expected ones since the last unexpected one
        self._misfit: int | None = None  # keyframe with which the run of unexpected ones under way began
        self._suspects: dict[int, _Suspect] = {}  # keyframe before which the robot may have been carried -> suspect
        self._begun = 0  # suspects before this keyframe are followed on new ground already
        self._looked_at = 0  # keyframe of the suspect whose candidate poses are being replayed
        self._log_best = self._log_ratio = 0.0  # log P(history, Z_1:k) of the best live one; entry threshold
        self._log_surplus = 0.0  # log ratio of its weight with near copies to that, when last computed
        self._origins: dict[int, Array] = {}  # keyframe -> (3,) last pose before carried to new ground

    @property
    def is_on(self) -> bool:
        """Whether the robot may be carried."""
        return self._replay.problem.carried is not None

    @property
    def may_be_stored(self) -> bool:
        """Whether its state is all that it needs to go on.

        Not so while new ground is followed, nor while candidate poses catch up. Those that have are stored right after
        a marginalisation.
        """
        follows = self._new_ground is not None and bool(self._suspects or self._new_ground.followed)
        return not follows and self._places.may_be_stored and (self._is_over or self._replay.may_be_stored)

    @property
    def first_step(self) -> int | None:
        """The oldest keyframe that histories may be replayed through from now on; None: none will be."""
        return None if self._is_over else self._replay.first_step

    @property
    def _checkpoints(self) -> StoredReplay | None:
        return None if self._is_over else self._replay.stored()

    @_checkpoints.setter
    def _checkpoints(self, told: StoredReplay | None) -> None:
        self._replay.restore(told)

    @property
    def _is_over(self) -> bool:
        """Whether no history is replayed, nor will be: the robot is not carried, or not searched for any more."""
        return not self.is_on or (self._is_too_late and not (self._suspects or self._places.lineages))

    def note(self, log_ratio: float) -> None:
        """Record by how many nats the newest keyframe was likelier under the reference than under the belief."""
        if not self.is_on:
            return
        self._num_expected += 1
        if self._is_too_late or not self._is_region_known:
            self._misfit = None
        elif self._new_ground is not None or self._replay.steps[-1].detections:  # a fixed map needs detections
            self._judge(log_ratio)
        self._num_noted += 1

    @property
    def _is_too_late(self) -> bool:
        """Whether no new suspects are noted: without a map, beyond ``revision.horizon``, since each costs replays."""
        return not self._replay.problem.map_ids and self._num_noted >= self._horizon

    @property
    def _is_region_known(self) -> bool:
        """Whether what is missed tells where the robot is, and not how little of the sensor's region is learned yet."""
        if not self._replay.problem.open_world.learn_region:
            return True
        sensed = self._replay.steps[-1].sensed
        return sensed is not None and bool(sensed.is_settled)

    def _judge(self, log_ratio: float) -> None:
        """Start or extend a suspect where the newest keyframe was unexpected; else end the run of such keyframes."""
        if not log_ratio > 0.0:
            self._misfit = None
            return
        self._num_expected = 0
        if self._misfit is None:
            self._misfit = self._num_noted
            if self._num_noted:
                self._suspects[self._num_noted] = _Suspect(log_ratio)
        elif self._misfit in self._suspects:
            self._suspects[self._misfit].log_ratio += log_ratio

    def not_carried(self, live: Mapping[int, Hypothesis], parent_ids: NDArray[np.uint64]) -> NDArray[np.bool_] | None:
        """(K,) whether the parents of candidates were not carried lately (``SOON``); None where none ever is."""
        if not self.is_on:
            return None
        carried = {number: is_carried_lately(hypothesis.lineage) for number, hypothesis in live.items()}
        return np.array([not carried[number] for number in parent_ids.tolist()], dtype=bool)

    def found(
        self, live: Mapping[int, Hypothesis], poses: Mapping[int, Array], log_evidence: float, ratio: float
    ) -> dict[int, Hypothesis]:
        """New hypotheses that weigh at least 1 / ``ratio`` of the best live one.

        ``poses``: pose (7,) of the robot in each live one. ``log_evidence``: the normaliser that live weights are
        relative to.
        """
        if not self.is_on:
            return {}
        best = next(iter(live.values()))
        self._log_best, self._log_ratio = best.log_weight + log_evidence - self._log_surplus, float(np.log(ratio))
        self._search(live, best, log_evidence)
        weighed = self._weighing(live, poses)
        if not weighed or not self._weigh(best, log_evidence):
            return {}
        entering = [history for history in weighed if history.log_joint - self._log_best >= -self._log_ratio]
        self._places.give_up(history.number for history in entering)
        if entering:
            for suspect in self._suspects.values():
                suspect.looked = len(self._replay.steps)
        return {history.number: self._entered(best, history) for history in entering}

    def _search(self, live: Mapping[int, Hypothesis], best: Hypothesis, log_evidence: float) -> None:
        """Begin histories at the newest suspects, and advance those under way."""
        if not self._replay.problem.is_placed(best.lineage):
            self._pass_over()
        self._keep_within_reach(best.lineage)
        if self._begins:
            self._begin(live)
            self._weigh(best, log_evidence)
        self._follow(live)
        due = self._due()
        if due is not None:
            self._weigh(best, log_evidence)
            self._look(due, live)
        self._places.go_on(self._log_best, self._log_unplaced)

    def _entered(self, best: Hypothesis, history: Revised) -> Hypothesis:
        """A history as a hypothesis that revises the ``best`` live one, with a weight in the unit of that one's."""
        log_weight = best.log_weight + (history.log_joint - self._log_best)
        return history.entering(best.owner, best, log_weight, self._log_surplus)

    def frame(self, grounds: Sequence[int]) -> Starts:
        """Start poses of the frame of a robot that was carried to new ground before the keyframes ``grounds``."""
        assert self._replay.problem.carried is not None
        return self._replay.problem.carried.frame(self._origins[grounds[0]], len(grounds))

    @property
    def _begins(self) -> list[int]:
        """Suspects from which new ground is not followed yet; none where the world is a fixed map."""
        return [] if self._new_ground is None else sorted(at for at in self._suspects if at >= self._begun)

    def _keep_within_reach(self, lineage: Lineage) -> None:
        """Follow the best history every few keyframes where replays begin near the newest one, so that they can."""
        if self._is_too_late and not self._suspects:
            return
        if self._replay.problem.history.is_on and len(self._replay.steps) % CHECKPOINT == 0:
            self._replay.followed(lineage)

    def _weigh(self, best: Hypothesis, log_evidence: float) -> bool:
        """Compute the best live hypothesis's own weight, without merged near copies; whether that is possible.

        Looks begin at the checkpoints of this replay.
        """
        followed = self._replay.followed(best.lineage)
        if followed is None:
            return False
        self._log_surplus = best.log_weight + log_evidence - followed.log_joint
        self._log_best = followed.log_joint
        return True

    def _weighing(self, live: Mapping[int, Hypothesis], poses: Mapping[int, Array]) -> list[Revised]:
        """Histories that may weigh enough and are unlike every live one."""
        on_new_ground = [] if self._new_ground is None else [history.progress for history in self._new_ground.followed]
        least = self._log_best - self._log_ratio - MARGIN
        likely = [history for history in [*self._places.through, *on_new_ground] if history.log_joint >= least]
        if not likely:
            return []
        known = [
            Account.of(hypothesis.lineage, planar_from_pose_vector(poses[number]))
            for number, hypothesis in live.items()
        ]
        return [
            self._replay.finished(replace(history, component=history.component.fork()))
            for history in likely
            if history.number not in live and not any(map(account(history).is_like, known))
        ]

    def _pass_over(self) -> None:
        """Drop the newest suspects: a robot that is not localised yet is searched for on the map anyway."""
        self._suspects = {at: suspect for at, suspect in self._suspects.items() if at < self._begun}
        self._begun = self._num_noted

    def _begin(self, live: Mapping[int, Hypothesis]) -> None:
        """Start histories on new ground from the suspects that are not followed yet."""
        assert self._new_ground is not None
        for since in self._begins:
            before = self._new_ground.begin(self._not_carried_lately(live, since), since)
            self._origins |= {since: before} if before is not None else {}
        self._begun = self._num_noted

    def _follow(self, live: Mapping[int, Hypothesis]) -> None:
        """Advance the histories on new ground."""
        if self._new_ground is None:
            return
        self._new_ground.go_on(self._log_best)
        followed = {history.since for history in self._new_ground.followed}
        lineages = [history.progress.lineage for history in self._new_ground.followed] + self._places.lineages
        grounds = [hypothesis.grounds for hypothesis in live.values()] + [new_grounds(lineage) for lineage in lineages]
        held = followed.union(*grounds)
        self._suspects = {at: suspect for at, suspect in self._suspects.items() if at in followed}
        self._origins = {at: origin for at, origin in self._origins.items() if at in held}

    def _due(self) -> int | None:
        """The most promising keyframe to look at now; None where none is, or an earlier look is more promising."""
        now = len(self._replay.steps)
        self._suspects = {at: suspect for at, suspect in self._suspects.items() if self._is_open(at, suspect, now)}
        due = {at: self._promise(at) for at, suspect in self._suspects.items() if self._is_due(at, suspect, now)}
        at = max(due, key=lambda at: due[at], default=None)
        return None if at is None or due[at] <= self._promised() else at

    def _is_open(self, since: int, suspect: _Suspect, now: int) -> bool:
        """Whether a suspect has looks left; one of long ago may expire, with a fixed map always."""
        oldest = self._replay.reach if self._new_ground is not None else now - LOOKS[0] - LOOKS[-1]
        return suspect.looks < len(LOOKS) and since >= oldest

    def _is_due(self, since: int, suspect: _Suspect, now: int) -> bool:
        """Whether a look is due; with a fixed map only where live histories leave unexpected keyframes."""
        if self._new_ground is not None:
            return now - since > LOOKS[suspect.looks]
        return now - max(since, suspect.looked) > LOOKS[0] and self._num_expected < now - suspect.looked

    def _promised(self) -> float:
        """How promising the look under way is: it gives way to a keyframe that became likelier meanwhile."""
        if not self._places.is_looking:
            return -np.inf
        return np.inf if self._new_ground is None else self._promise(self._looked_at)

    def _promise(self, since: int) -> float:
        """Log weight of being carried before a keyframe, if what was seen since may localise the robot; else -inf.

        With a fixed map: how unexpected that keyframe was.
        """
        if self._new_ground is None:
            return self._suspects[since].log_ratio
        followed = self._new_ground.at(since)
        if followed is None or followed.num_recognisable < LEAST_OBJECTS:
            return -np.inf
        return followed.progress.log_joint if followed.progress.log_joint >= self._log_best - PROMISING else -np.inf

    def _not_carried_lately(self, live: Mapping[int, Hypothesis], since: int) -> Lineage:
        """The likeliest history not carried within ``SOON`` keyframes before this one, or else the likeliest."""
        lineages = [
            hypothesis.lineage for hypothesis in live.values() if not is_carried_lately(hypothesis.lineage[:since])
        ]
        return [*lineages, next(iter(live.values())).lineage][0]

    def _look(self, since: int, live: Mapping[int, Hypothesis]) -> None:
        """Begin to replay histories carried just before a keyframe, if there are new detections since the last look."""
        steps, suspect = self._replay.steps[since:], self._suspects[since]
        suspect.looks = sum(len(steps) > apart for apart in LOOKS)
        before = self._before(self._not_carried_lately(live, since), since)
        if before is None or num_seen(steps) == suspect.num_seen:
            return
        self._looked_at, suspect.looked, suspect.num_seen = since, len(self._replay.steps), num_seen(steps)
        self._places.begin(before, self._points(before, since))

    def _before(self, lineage: Lineage, since: int) -> Progress | None:
        """A history up to a keyframe: as known from when new ground was begun there, else replayed."""
        known = None if self._new_ground is None else self._new_ground.before(since, lineage)
        return known or self._replay.before(lineage, since)

    def _points(self, before: Progress, since: int) -> list[int | None]:
        """Lattice points that are likely given the detections since."""
        problem, robot = self._replay.problem, before.component.newest_robot()[:3]
        assert problem.carried is not None
        poses = likely_poses(problem, self._registry, before.component, self._replay.steps[since:])
        return list(dict.fromkeys(problem.carried.point(se2.between(robot, pose)) for pose in poses))

    def _log_unplaced(self, at: int) -> float:
        """Log weight of a history that is localised but recognises nothing, after ``at`` keyframes."""
        followed = None if self._new_ground is None else self._new_ground.at(self._looked_at)
        carried = self._replay.problem.carried
        return (
            -np.inf
            if followed is None or carried is None
            else followed.log_joints[at - 1 - followed.since] + carried.log_place
        )
