"""Answers backends that were started late or restarted and request the keyframes they have missed."""

import queue
from collections import Counter
from collections.abc import Collection

from semantic_slam.errors import InputError, MessageError
from semantic_slam.inference.protocol import MissedKeyframes
from semantic_slam.messages import topics
from semantic_slam.messages.codec import decode, encode
from semantic_slam.pipeline.journal.kept_run import KeptRun
from semantic_slam.ros.wire.transport import Outlet

MOST_TOLD = 500
"""Keyframes sent at once, which bounds memory on both sides; a backend that missed more asks again."""


class MissedQuestions:
    """Requests for missed keyframes; received on the executor's thread, answered on the worker's.

    ``refused`` counts invalid or unanswerable requests by topic and reason, ``repeated`` the valid ones by topic.
    """

    def __init__(self, backend_ids: Collection[int], refused: Counter[str], repeated: Counter[str]) -> None:
        self._backend_ids, self._refused, self._repeated = frozenset(backend_ids), refused, repeated
        self._asked: queue.SimpleQueue[bytes] = queue.SimpleQueue()

    def ask(self, data: bytes) -> None:
        """Queue a serialised message of :data:`~semantic_slam.messages.topics.MISSED`."""
        self._asked.put(data)

    def answer(self, run_id: str, kept: KeptRun, end: int, outlet: Outlet) -> bool:
        """Send the requested keyframes before ``end``; returns whether the requesting backends then know all of them.

        If more than :data:`MOST_TOLD` are missing, only the oldest ones are sent, and the newest, which makes the
        backend ask again. If the keyframes cannot be read from disk, that is counted as refused, and the backend asks
        again at the next keyframe.
        """
        first = [question.keyframe for question in self._questions(run_id, kept.num_keyframes)]
        if not first:
            return False
        middle = min(min(first) + MOST_TOLD, end)
        try:
            missed = kept.keyframes(min(first), middle) + kept.keyframes(max(middle, end - 1), end)
        except (InputError, OSError):
            self._refused[f"{topics.MISSED}: the keyframes that were kept cannot be read"] += 1
            return False
        for keyframe in missed:
            outlet.send(encode(keyframe, run_id=run_id, again=True))
        return middle == end

    def _questions(self, run_id: str, num_keyframes: int) -> list[MissedKeyframes]:
        """The valid requests received so far; invalid ones are counted as refused."""
        questions = []
        while not self._asked.empty():
            try:
                question = decode(self._asked.get(), topics.TYPES[topics.MISSED])
            except MessageError as fault:
                self._refused[f"{topics.MISSED}: {fault.kind}"] += 1
                continue
            reason = self._fault_of(question, run_id, num_keyframes)
            if reason:
                self._refused[f"{topics.MISSED}: {reason}"] += 1
            else:
                self._repeated[topics.MISSED] += 1
                questions.append(question)
        return questions

    def _fault_of(self, question: MissedKeyframes, run_id: str, num_keyframes: int) -> str:
        if question.run_id != run_id:
            return "of another run"
        if question.backend_id not in self._backend_ids:
            return "of a backend that there is not"
        return "of a keyframe that there is not yet" if question.keyframe > num_keyframes else ""
