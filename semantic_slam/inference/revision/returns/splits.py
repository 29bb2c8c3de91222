"""Search for histories in which a return was to another object, with everything that follows from it.

A wrong loop closure bends the whole drive: things seen before and after lie apart. So an object is split at a return,
the whole drive is solved again, and objects that then coincide are merged, as long as that makes the history likelier.
Rough weights select what is worth a replay.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.revision.returns.first_and_missed import FirstAndMissed
from semantic_slam.inference.revision.returns.run_model import RunModel
from semantic_slam.inference.revision.returns.runs import Parting, Runs, numbered, offsets
from semantic_slam.inference.revision.returns.solution import Solution, solved
from semantic_slam.inference.revision.returns.whole_drive import WholeDrive

MOST_JOINED = 4
"""Most merges after one split."""
MOST_PAIRS = 8
"""Pairs of objects whose detections and misses are evaluated before a merge."""
UNLIKELY = 10.0
"""Nats lost by position in a merge beyond which detections and misses are not evaluated."""


@dataclass(frozen=True)
class Weighed:
    """A history given by the objects of its atoms, with its rough weight."""

    objects: Index  # (A,)
    solution: Solution
    log_weight: float  # roughly, up to a constant of the drive


@dataclass(frozen=True, kw_only=True)
class Splits:
    """Looks for likelier histories around one, whose objects are unions of the atoms of ``runs``."""

    drive: WholeDrive
    runs: Runs
    record: FirstAndMissed
    path: Array  # (1 + T, 3) of the history at hand

    def best(self, count: int, is_news: Callable[[Parting], bool]) -> list[tuple[Parting, Index, float]]:
        """At most ``count`` new partings, each with the objects of the detections and the rough log gain.

        Raises numpy.linalg.LinAlgError where the history at hand is indeterminate and there are any.
        """
        partings = [parting for parting in self.runs.partings() if is_news(parting)]
        if not partings:
            return []
        own = self._weighed(self.runs.objects, self.path)
        model = RunModel.at(self.drive, self.runs, own.solution, own.objects)
        scores = [model.log_evidence(parting.objects) for parting in partings]
        found: list[tuple[Parting, Index, float]] = []
        for row in np.argsort(-np.array(scores), kind="stable")[:count].tolist():
            after = self._followed_up(partings[row], own.solution.path)
            if after is not None and not np.array_equal(after.objects, own.objects):
                gain = after.log_weight - own.log_weight
                found.append((partings[row], after.objects[self.runs.detections], gain))
        return found

    def _followed_up(self, parting: Parting, path: Array) -> Weighed | None:
        """The likeliest history among a parting and the merges that follow it; None: none is solvable."""
        try:
            now = best = self._weighed(parting.objects, path)
            for _ in range(MOST_JOINED):
                joined = self._joined(now, parting)
                if joined is None:
                    break
                now = self._weighed(joined, now.solution.path)
                best = max(best, now, key=lambda own: own.log_weight)
        except np.linalg.LinAlgError:
            return None
        return best

    def _weighed(self, objects: Index, path: Array) -> Weighed:
        solution = solved(self.drive, objects[self.runs.detections], path)
        likely = self.record.by_object(solution.path, solution.places, self.runs.seen_of(objects)).sum(axis=0)
        births = len(solution.places) - self.runs.num_mapped
        return Weighed(objects, solution, solution.log_evidence + self.record.log_probability(births, likely))

    def _joined(self, now: Weighed, parting: Parting) -> Index | None:
        """The objects of the atoms after the merge of two that gains most; None where no merge gains."""
        pairs = self._pairs(now, parting)
        if not pairs:
            return None
        gains = self._gains(now, pairs)
        best = int(np.argmax(gains))
        if gains[best] <= 0.0:
            return None
        older, younger, _ = pairs[best]
        return numbered(np.where(now.objects == younger, older, now.objects))

    def _pairs(self, now: Weighed, parting: Parting) -> list[tuple[int, int, float]]:
        """Pairs of objects that may be one, with their gain by position, largest first."""
        places, seen = now.solution.places, self.runs.seen_of(now.objects)
        away, spread = offsets(places, now.solution.covariance)
        mapped, log_new = self.runs.num_mapped, float(np.median(self.record.log_intensities))
        apart = [int(now.objects[np.flatnonzero(parting.objects == number)[0]]) for number in parting.parted]
        may_be = np.triu(~_together(seen), 1)
        may_be[:, :mapped] = False
        may_be[min(apart), max(apart)] = False
        older, younger = np.nonzero(may_be)
        off, spread = away[older, younger], spread[older, younger]
        squared = (off * np.linalg.solve(spread, off[..., None])[..., 0]).sum(axis=1)
        gains = -0.5 * squared - 0.5 * np.linalg.slogdet(2.0 * np.pi * spread)[1]
        rows = np.flatnonzero(gains - log_new > -UNLIKELY)
        best = rows[np.argsort(-gains[rows], kind="stable")[:MOST_PAIRS]]
        return list(zip(older[best].tolist(), younger[best].tolist(), gains[best].tolist(), strict=True))

    def _gains(self, now: Weighed, pairs: Sequence[tuple[int, int, float]]) -> Array:
        """(n,) gains of pairs by positions, detections and misses."""
        path, places, seen = now.solution.path, now.solution.places, self.runs.seen_of(now.objects)
        likely = self.record.by_object(path, places, seen)
        births, total = len(places) - self.runs.num_mapped, likely.sum(axis=0)
        before = self.record.log_probability(births, total)
        older, younger = (np.array([pair[row] for pair in pairs]) for row in range(2))
        times = seen.sum(axis=1)
        at = np.where((times[younger] > times[older]) & (older >= self.runs.num_mapped), younger, older)
        both = self.record.by_object(path, places[at], seen[older] | seen[younger], older)
        after = [
            self.record.log_probability(births - 1, total - likely[one] - likely[other] + both[row])
            for row, (one, other, _) in enumerate(pairs)
        ]
        return np.asarray(np.array([gain for _, _, gain in pairs]) + np.array(after) - before)


def _together(seen: Flags) -> Flags:
    """(N, N) whether two objects are seen in one frame, from (N, T) whether each is."""
    often = seen.astype(np.float32)
    return np.asarray(often @ often.T > 0.0)
