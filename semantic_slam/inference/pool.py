"""A pool of backends within this process, for offline use of the engine."""

from collections.abc import Mapping

from semantic_slam.errors import InputError
from semantic_slam.inference.backend import Backend
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.protocol import Candidates, Commit, Components, RunConfiguration
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.world.problem import Problem


class InProcessPool:
    """``number`` backends that are called one after the other."""

    def __init__(self, number: int, problem: Problem | None = None):
        """Raises InputError where ``number`` is below 1."""
        if not (isinstance(number, int) and number >= 1):
            raise InputError(f"backends is {number!r}; give a whole number of at least one backend")
        self.backend_ids = tuple(range(number))
        self._backends = [Backend(n, problem) for n in self.backend_ids]

    def start(self, run: RunConfiguration) -> None:
        """Begin a run."""
        for backend in self._backends:
            backend.start(run)
        first = self._backends[0]
        if first.problem.history.is_on:
            for backend in self._backends:
                backend.share(first.trunks)

    def tell(self, keyframe: Keyframe) -> None:
        """Record a keyframe in all backends, without expanding it."""
        for backend in self._backends:
            backend.learn(keyframe)

    def begin(self, keyframe: Keyframe) -> None:
        """Nothing: backends of this process work when they are asked."""

    def expand(self, keyframe: Keyframe) -> list[Candidates]:
        """Round one: the candidates of every live hypothesis."""
        return [backend.expand(keyframe) for backend in self._backends]

    def commit(self, commit: Commit) -> list[Components]:
        """Round two: fork and update the survivors, and report their marginals."""
        answers = [backend.commit(commit) for backend in self._backends]
        return [answer for answer in answers if answer is not None]

    def offer(self, components: Mapping[int, Component]) -> None:
        """Hand over components by hypothesis, which the next commit then need not rebuild."""
        for backend in self._backends:
            backend.offer(components)

    @property
    def num_steps_in_memory(self) -> int:
        """Largest number of keyframes that a backend holds in memory; older ones are on disk."""
        return max(len(backend.steps) - backend.steps.num_on_disk for backend in self._backends)

    def component(self, number: int) -> Component:
        """The component of a live hypothesis, whichever backend holds it. Raises KeyError."""
        held = next((backend.held for backend in self._backends if number in backend.held), {})
        return held[number].component
