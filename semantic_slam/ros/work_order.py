"""The order of a backend's work: announcement, then keyframe and commit in turn, whatever the order of arrival.

Each topic keeps its own order, different topics have none: a commit may arrive before the keyframe it belongs to, and
after a restart all of them arrive at once. Nothing here knows ROS.
"""

from semantic_slam.inference.backend import Backend
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.protocol import Candidates, Commit, Components, RunConfiguration

Answer = Candidates | Components


class WorkOrder:
    """Feeds one backend and returns its answers."""

    def __init__(self, backend: Backend) -> None:
        self._backend = backend
        self._run_id = ""
        self._num_expanded = 0  # keyframes expanded
        self._num_committed = 0
        self._keyframes: dict[tuple[str, int], Keyframe] = {}
        self._commits: dict[tuple[str, int], Commit] = {}

    def start(self, run: RunConfiguration) -> list[Answer]:
        """A run is announced; a second announcement comes from a manager that was started anew."""
        self._backend.start(run)
        self._run_id = run.run_id
        self._num_expanded = self._num_committed = 0
        return self._advance()

    def keyframe(self, run_id: str, keyframe: Keyframe) -> list[Answer]:
        """Round one. The newest keyframe is answered again; older ones are stale."""
        again = keyframe.index == self._num_expanded - 1 == self._num_committed
        if run_id == self._run_id and again and keyframe.index > 0:
            return [self._backend.expand(keyframe)]
        self._keyframes[run_id, keyframe.index] = keyframe
        return self._advance()

    def commit(self, commit: Commit) -> list[Answer]:
        """Round two. One that was already followed is idempotent in the backend, and ignored there when stale."""
        if commit.run_id == self._run_id and commit.keyframe < self._num_committed:
            answer = self._backend.commit(commit)
            return [answer] if answer is not None else []
        self._commits[commit.run_id, commit.keyframe] = commit
        return self._advance()

    def _advance(self) -> list[Answer]:
        """Do all that can be done by now, in turn."""
        answers: list[Answer] = []
        while True:
            if self._num_committed == self._num_expanded:
                keyframe = self._keyframes.pop((self._run_id, self._num_expanded), None)
                if keyframe is None:
                    return answers
                answers.append(self._backend.expand(keyframe))
                self._num_expanded += 1
            else:
                commit = self._commits.pop((self._run_id, self._num_committed), None)
                if commit is None:
                    return answers
                answer = self._backend.commit(commit)
                answers += [answer] if answer is not None else []
                self._num_committed += 1
