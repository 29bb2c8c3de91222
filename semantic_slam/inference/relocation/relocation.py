"""Global localisation of a lost robot: histories that place what it has mapped in its own frame on the given map.

Such a history begins at a start pose of its own, and names objects of the map in place of those that the robot had
started. It is replayed from there, a few keyframes at a time, and enters with its P(history, Z_1:k) once it has caught
up. Nothing is decided here: evidence decides between start poses, and what is ambiguous remains so.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from semantic_slam.configuration import RevisionConfiguration
from semantic_slam.inference.hypotheses import Hypothesis
from semantic_slam.inference.relocation.placements import Placements
from semantic_slam.inference.relocation.stretches import parted, stretches
from semantic_slam.inference.revision.catching_up import CatchingUp
from semantic_slam.inference.revision.replay import Replay, Revised
from semantic_slam.inference.states.lineage import Lineage
from semantic_slam.inference.world.objects import ObjectRegistry

AGAIN = 30
"""Keyframes after which a placement that was tried may be tried again."""
SELDOM = 2
"""Factor on the interval between looks once all hypotheses are localised."""
MARGIN = 60.0
"""Nats below the entry threshold at which a placement is still replayed: its predicted weight is rough."""


@dataclass(frozen=True)
class _Lost:
    """A history in which the robot is not localised on the map."""

    lineage: Lineage
    log_surplus: float  # log ratio of its weight with merged near copies to its own


class Relocation:
    """Proposes and weighs histories that localise a robot not yet localised on the map."""

    def __init__(self, settings: RevisionConfiguration, replay: Replay, registry: ObjectRegistry) -> None:
        self.settings, self._replay, self._registry = settings, replay, registry
        self._parted = Replay(replay.problem, replay.association, replay.steps)  # without returns after blind stretches
        self._looks = 0
        self._tried: dict[object, int] = {}
        self._lost: _Lost | None = None
        self._catching_up = CatchingUp(replay)

    @property
    def is_on(self) -> bool:
        """Whether the robot started lost (unknown start pose)."""
        return self._replay.problem.starts is not None

    @property
    def is_over(self) -> bool:
        """Whether no history is replayed, nor will be: the robot did not start lost, or it is too late."""
        is_too_late = len(self._replay.steps) > self.settings.horizon
        return not self.is_on or (is_too_late and self._catching_up.is_idle)

    def placed(self, live: Mapping[int, Hypothesis], log_evidence: float, ratio: float) -> dict[int, Hypothesis]:
        """New hypotheses that weigh at least 1 / ``ratio`` of the best live one.

        ``log_evidence``: the normaliser that live weights are relative to.
        """
        if not self.is_on:
            return {}
        best = next(iter(live.values()))
        log_least = best.log_weight + log_evidence - float(np.log(ratio))
        if self._is_due(live):
            self._look(live, log_evidence, log_least)
        found: dict[int, Hypothesis] = {}
        for _, own in self._catching_up.go_on():
            assert self._lost is not None
            log_weight = -np.inf if own is None else own.log_joint + self._lost.log_surplus
            if own is not None and own.number not in live and log_weight >= log_least:
                lost = self._likeliest_lost(live)
                revises, log_surplus = lost or best, self._lost.log_surplus
                found[own.number] = own.entering(best.owner, revises, log_weight - log_evidence, log_surplus)
        return found

    def _is_due(self, live: Mapping[int, Hypothesis]) -> bool:
        """Whether a look is due at the newest keyframe: less often where all hypotheses are localised."""
        count, every = len(self._replay.steps), self.settings.lost_every_keyframes
        if not self._catching_up.is_idle or not 1 < count <= self.settings.horizon:
            return False
        apart = every if self._likeliest_lost(live) else SELDOM * every
        return (count + every // 2) % apart == 0  # not in the keyframes in which objects are merged

    def _likeliest_lost(self, live: Mapping[int, Hypothesis]) -> Hypothesis | None:
        """The heaviest live hypothesis that does not localise the robot."""
        is_placed = self._replay.problem.is_placed
        return next((own for own in live.values() if not is_placed(own.lineage)), None)

    def _look(self, live: Mapping[int, Hypothesis], log_evidence: float, log_least: float) -> None:
        """Begin to replay placements of the likeliest history that is not localised.

        Once all of these are pruned, its likeliest continuation is still followed, so that a wrongly localised robot
        recovers.
        """
        lost = self._followed(live, log_evidence)
        if lost is None:
            return
        self._looks += 1
        lost, is_parted = self._forgetful(lost) if self._looks % 2 == 0 else (lost, False)
        problem, now = self._replay.problem, len(self._replay.steps)
        assert problem.starts is not None
        placements = Placements(
            problem=problem,
            starts=problem.starts,
            steps=self._replay.steps,
            lineage=lost.lineage,
            component=lost.component,
            expected_births=lost.expected_births,
            is_parted=is_parted,
        )
        assert self._lost is not None
        least = log_least - self._lost.log_surplus - lost.log_joint - MARGIN
        taken = {problem.start_of(problem.root_number(own.lineage)) for own in live.values()}
        for placement in placements.best(self.settings.proposals, taken):
            again = now - self._tried.get(placement.what, -AGAIN) >= AGAIN
            if placement.log_gain >= least and again:
                self._tried[placement.what] = now
                self._catching_up.add([placement.lineage])

    def _followed(self, live: Mapping[int, Hypothesis], log_evidence: float) -> Revised | None:
        """The likeliest history that is not localised, replayed up to now."""
        lost, before = self._likeliest_lost(live), self._lost
        known = lost or before
        followed = self._replay.followed(known.lineage) if known is not None else None
        if followed is None:
            return None
        surplus = before.log_surplus if before is not None else 0.0
        if lost is not None:  # its weight may include near copies, which its placements inherit
            surplus = lost.log_weight + log_evidence - followed.log_joint
        self._lost = _Lost(followed.lineage, surplus)
        return followed

    def _forgetful(self, lost: Revised) -> tuple[Revised, bool]:
        """The history without its returns (loop closures) after blind stretches, and whether there were any."""
        steps = self._replay.steps
        lineage = parted(lost.lineage, stretches(steps), self._registry.first_new_id)
        if lineage == lost.lineage:
            return lost, False
        found = self._parted.followed(lineage)
        return (lost, False) if found is None else (found, True)
