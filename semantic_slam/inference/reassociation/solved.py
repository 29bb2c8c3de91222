"""Components solved again with reassociated detections, and their weight."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.configuration import NewObjectConfiguration, OpenWorldConfiguration
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.open_world.planar.region import SensorRegion
from semantic_slam.inference.reassociation.accounts import StretchAccount
from semantic_slam.inference.reassociation.atoms import Atoms
from semantic_slam.inference.reassociation.revised_states import revised_objects, revised_tracking
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.smoothing.reassociation import brought_together, log_evidence, reassociated
from semantic_slam.inference.smoothing.smoother import Smoother
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.keys import object_key, robot_key
from semantic_slam.inference.states.lineage import Reassigned


@dataclass(frozen=True)
class RevisedComponent:
    """A component, the changes that made it, and its gain."""

    component: Component
    changes: tuple[Reassigned, ...] = ()
    log_gain: float = 0.0  # log ratio of P(history, Z_1:k) with and without the changes


@dataclass(frozen=True, kw_only=True)
class Solver:
    """Makes revised components, deterministically from the changes alone."""

    settings: OpenWorldConfiguration
    new_objects: NewObjectConfiguration
    region: SensorRegion  # as known now

    def revised(self, component: Component, atoms: Atoms) -> RevisedComponent:
        """The component with the objects that ``atoms`` have afterwards. Raises LostComponentError."""
        smoother = self._solved(component, atoms)
        before, after = self._accounts(component, smoother, atoms)
        accounted, log_weights = component.objects.rates.explained(after.log_likelihoods - before.log_likelihoods)
        objects = revised_objects(component.objects, atoms, before, after, log_weights)
        tracked = revised_tracking(component, smoother, objects.ids)
        started = len(np.unique(atoms.objects)) - len(np.unique(atoms.sighted.objects))
        places = log_evidence(smoother) - log_evidence(component.smoother) + started * self._log_object(component)
        own = replace(component, smoother=smoother, objects=objects, tracked=tracked, local=None)
        if own.movers is not None:  # what may move is also among the static objects
            own = replace(own, movers=own.movers.take(own.movers.decided | np.isin(own.movers.ids, objects.ids)))
        return RevisedComponent(own, atoms.changes(), float(places + accounted))

    def parted(self, component: Component, objects: Index, parts: Mapping[int, int]) -> Smoother:
        """The drive with detections of ``objects`` (n,); ``parts`` start where the objects they split from are."""
        if not parts:
            return component.smoother
        states = component.states([object_key(source) for source in parts.values()])
        size, spread = component.spaces.storage.landmark, np.diag(np.square(self._sigmas(component)))
        priors = zip(parts, states[:, :size], strict=True)
        return reassociated(component.smoother, objects, {part: GaussianPrior(at, spread) for part, at in priors})

    def _solved(self, component: Component, atoms: Atoms) -> Smoother:
        """The whole drive with the objects afterwards: split into atoms, pulled together, then renamed."""
        new = {atom: source for atom, source in atoms.sources.items() if atom != source}
        smoother = self.parted(component, atoms.atoms, new)
        if atoms.joins:
            smoother = brought_together(smoother, atoms.joins)
        if not np.array_equal(atoms.objects, atoms.atoms):
            smoother = reassociated(smoother, atoms.objects, {})
        return smoother

    def _accounts(self, component: Component, smoother: Smoother, atoms: Atoms) -> Sequence[StretchAccount]:
        """Accounts of the history before and after, from the first keyframe at which they differ."""
        begin = int(atoms.sighted.keyframes[atoms.objects != atoms.sighted.objects].min(initial=component.keyframe))
        keys = [robot_key(keyframe) for keyframe in range(component.keyframe + 1)]
        return [
            StretchAccount(
                settings=self.settings,
                rates=component.objects.rates,
                region=self.region,
                path=own.states(keys)[:, :3],
                begin=begin,
                ids=ids,
                places=own.states([object_key(int(n)) for n in ids])[:, :2],
                seen=_seen(ids, objects, atoms.sighted.keyframes, len(keys)),
            )
            for own, ids, objects in _histories(component, smoother, atoms)
        ]

    def _sigmas(self, component: Component) -> Array:
        """(l,) standard deviations of the prior of a new object."""
        new, size = self.new_objects, component.spaces.layout.landmark
        return np.array([new.sigma_position_m] * 2 + [new.sigma_heading_rad] * (size - 2))

    def _log_object(self, component: Component) -> float:
        """Log term of a new object beyond the factors: intensity one per square metre, and an unmeasured heading."""
        return float(np.log(2.0 * np.pi) - np.log(self._sigmas(component)[2:]).sum())


def _histories(component: Component, smoother: Smoother, atoms: Atoms) -> Iterator[tuple[Smoother, Index, Index]]:
    """Smoother, object ids, and the object of each detection, before and after.

    Objects that were dropped count in neither.
    """
    before, old, new = component.objects.ids, atoms.sighted.objects, atoms.objects
    yield component.smoother, before, old
    given_up, unseen = np.setdiff1d(old, before), np.setdiff1d(before, old)
    yield smoother, np.setdiff1d(np.union1d(new, unseen), given_up), new


def _seen(ids: Index, objects: Index, keyframes: Index, count: int) -> Flags:
    """(O, count) whether each of ``ids`` is detected in each keyframe."""
    seen, known = np.zeros((len(ids), count), dtype=bool), np.isin(objects, ids)
    seen[np.searchsorted(ids, objects[known]), keyframes[known]] = True
    return seen
