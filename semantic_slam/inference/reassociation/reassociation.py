"""Loop-closure reassociation: detections of long ago are assigned to other objects, weighed in closed form.

A robot that comes back after a long way may take one place for another, or map it a second time. So at intervals the
objects that it saw again lately are split from what was known before, which frees that stretch of the drive, and the
best set of pairs of one object each is sought in the joint Gaussian of both. The whole drive is solved again with these
pairs. The weight relative to the history as it was is the ratio of two integrals, each a Gaussian (Laplace) at its own
estimate, times the likelihoods of first detections, later detections and misses of the stretch, and those of detector
labels. The revised history enters beside the old one, and pruning decides. Nothing is replayed, so drives may be of any
length.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from semantic_slam.inference.association.strategy import AssociationStrategy, Parents
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.open_world.planar.region import sensor_region
from semantic_slam.inference.reassociation.atoms import Atoms
from semantic_slam.inference.reassociation.solved import RevisedComponent, Solver
from semantic_slam.inference.reassociation.stretch import Stretch
from semantic_slam.inference.semantics.interface import RetellsViews
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.smoothing.reassociation import Sighted
from semantic_slam.inference.states.lineage import Reassigned
from semantic_slam.inference.world.problem import Problem

LEAST_SHARE = 0.2
"""Least weight of a hypothesis to be examined; only few hypotheses matter."""
LEAST_GAIN = 5.0
"""Log gain [nats] that a revised history needs to enter: the account of a stretch may be off by as much."""
LEAST_CHANGED = 3
"""Number of objects with changed detections from which on a history is weighed: a place has several objects."""
LONGEST = 8
"""Length of the longest stretch examined, in intervals between looks."""


class Reassociation:
    """Looks for likelier reassociations and makes their components; a pure function of its inputs."""

    def __init__(self, problem: Problem, association: AssociationStrategy) -> None:
        self._problem, self._association = problem, association
        self._every = problem.revision.reassociate_every_keyframes
        semantics = problem.semantics
        self._retells = isinstance(semantics, RetellsViews) and semantics.retells
        self.is_on = self._every > 0 and not problem.objects and association.counts_misses  # without a prior map

    def looked_for(self, step: Step, parents: Parents) -> dict[int, RevisedComponent]:
        """Row of a parent -> a revised component likelier than it."""
        if step.index <= self._problem.revision.horizon or step.index % self._every:
            return {}
        likely = np.flatnonzero(parents.log_weights >= np.log(LEAST_SHARE)).tolist()
        found = {place: self._likelier(step, parents.components[place]) for place in likely}
        return {place: own for place, own in found.items() if own is not None}

    def revised(self, step: Step, component: Component, changes: Sequence[Reassigned]) -> RevisedComponent:
        """The component with ``changes`` applied, a function of these alone. Raises LostComponentError."""
        atoms = Atoms.of(Sighted.of(component.smoother), changes, self._born)
        own = self._solver(step, component).revised(component, atoms)
        return self._retold(own) if component.views else own

    def _retold(self, own: RevisedComponent) -> RevisedComponent:
        """The revision with semantic views moved to the objects that they now belong to, and their evidence."""
        semantics, log_prior_of = self._problem.semantics, self._association.registry.log_class_prior_of
        assert isinstance(semantics, RetellsViews)
        gain, views = semantics.retold(own.component.views, own.changes, log_prior_of)
        kept = {number: record for number, record in views.items() if number in own.component.every_id}
        return replace(own, component=replace(own.component, views=kept), log_gain=own.log_gain + gain)

    def _likelier(self, step: Step, component: Component) -> RevisedComponent | None:
        """A revised history that gains enough; None: none was found."""
        if component.smoother.in_charts is None or component.classes or (component.views and not self._retells):
            return None
        try:
            changes = self._changes(step, component)
            is_worth_it = len({object_id for _, _, object_id, _ in changes}) >= LEAST_CHANGED
            own = self.revised(step, component, changes) if is_worth_it else None
        except LostComponentError:
            return None
        return own if own is not None and own.log_gain >= LEAST_GAIN else None

    def _changes(self, step: Step, component: Component) -> tuple[Reassigned, ...]:
        """Changes that merge the best set of pairs of a stretch; none where the history has it already."""
        sighted = Sighted.of(component.smoother)
        stretch = Stretch.of(sighted, component.objects, step.index - self._length(step.index), self._born)
        if not stretch.looks_strange(component):
            return ()
        smoother = self._solver(step, component).parted(component, stretch.objects, stretch.started)
        rates = component.objects.rates
        log_new = float(np.log(rates.average(rates.birth_density)))  # detected either way
        joined = stretch.joined(stretch.best_joins(smoother, log_new))
        return Atoms(sighted, stretch.objects, joined).changes()

    def _length(self, index: int) -> int:
        """How many keyframes a look at keyframe ``index`` goes back: longer stretches are examined less often."""
        length = 2 * self._every
        while length < LONGEST * self._every and index % length == 0:
            length *= 2
        return length

    def _solver(self, step: Step, component: Component) -> Solver:
        region = sensor_region(self._problem.open_world).reaching(step.sensed).read_by(component.noise_settings)
        return Solver(settings=self._problem.open_world, new_objects=self._problem.model.new_objects, region=region)

    def _born(self, keyframe: int, number: int) -> int:
        """Id of the object that a detection would start."""
        return self._association.registry.first_new_id(keyframe) + number
